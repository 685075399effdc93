// SPDX-License-Identifier: Apache-2.0
// Shares jobs among processes, possibly on several machines, that have access to the same folders.
//
// The process that trains a job holds a claim file beside the job's folder. The file is created exclusively, and its
// time is renewed while the process lives. If a file is no longer renewed, its process counts as dead, and another
// process takes over the claim. No clocks are compared: each process measures with its own clock how long a file has
// not changed.
//
// A process that has seen a job fail notifies the others with a second file, which remains after the process ends.
// Other processes accept the failure if that file was written or renewed while they were running; processes started
// later ignore it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

namespace gs {

/// A claim held by this process. The destructor releases it.
class JobClaim {
  public:
    /// With `leave` the file stays after release, but no longer belongs to any process.
    JobClaim(std::filesystem::path file, std::string owner, std::chrono::milliseconds renew_every, bool leave = false);
    ~JobClaim();
    JobClaim(const JobClaim&) = delete;
    JobClaim& operator=(const JobClaim&) = delete;

    /// Returns whether another process took over the claim because this process seemed dead.
    bool lost() const;

  private:
    void renew();

    const std::filesystem::path file_;
    const std::string owner_;
    const std::chrono::milliseconds renew_every_;
    const bool leave_;
    mutable std::mutex mutex_;
    std::condition_variable wake_;
    bool ends_ = false, lost_ = false;  ///< guarded by mutex_
    std::thread renewer_;
};

/// The content of a file written by `tell`, and the time of its last renewal.
struct JobNote {
    std::string owner, text;
    std::filesystem::file_time_type time = std::filesystem::file_time_type::min();

    friend bool operator==(const JobNote&, const JobNote&) = default;
};

/// Returns the content of the file; empty if there is none, or if it cannot be read at the moment.
JobNote read_note(const std::filesystem::path& file);

/// Observations that this process has made of other processes' claims.
class JobClaims {
  public:
    /// A claim that does not change for `stale_after` belongs to no process.
    explicit JobClaims(std::chrono::milliseconds stale_after) : stale_after_(stale_after) {}

    /// Returns whether another process holds the claim.
    bool held(const std::filesystem::path& file);
    /// Takes the claim; null if another process holds it or took it at the same moment. Throws DataError naming the
    /// file if it cannot be written.
    std::unique_ptr<JobClaim> take(const std::filesystem::path& file);
    /// Publishes a note to other processes: takes over the claim, whoever holds it, and adds the note to the file,
    /// which remains. Throws DataError naming the file if it cannot be written.
    std::unique_ptr<JobClaim> tell(const std::filesystem::path& file, const std::string& note);

  private:
    struct Seen {
        std::string owner;
        std::filesystem::file_time_type time;
        std::chrono::steady_clock::time_point since;
    };

    const std::chrono::milliseconds stale_after_;
    std::map<std::filesystem::path, Seen> seen_;
};

}  // namespace gs
