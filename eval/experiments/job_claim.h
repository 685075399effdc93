// SPDX-License-Identifier: Apache-2.0
// Shares jobs among processes, also of several machines, that see the same folders.
//
// Whoever trains a job holds a file beside its folder, which was created exclusively and whose time is renewed while
// the process lives. A file that is no longer renewed belongs to a process that is gone, and another takes its place.
// No clocks are compared: each process judges by its own how long a file has not changed.
//
// A process that has seen a job fail tells the others by a second file, which stays when it ends. They take its word
// if the file was written or renewed while they were at work; to those that start later it says nothing.
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

/// A claim that this process holds. It is given back at the end of the object's life.
class JobClaim {
  public:
    /// With `leave` the file stays, but no longer belongs to anybody.
    JobClaim(std::filesystem::path file, std::string owner, std::chrono::milliseconds renew_every, bool leave = false);
    ~JobClaim();
    JobClaim(const JobClaim&) = delete;
    JobClaim& operator=(const JobClaim&) = delete;

    /// Whether another process took the claim, since this one seemed to be gone.
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

/// What a file of `tell` says, and when that was last renewed.
struct JobNote {
    std::string owner, text;
    std::filesystem::file_time_type time = std::filesystem::file_time_type::min();

    friend bool operator==(const JobNote&, const JobNote&) = default;
};

/// Returns what the file says; empty if there is none, or it cannot be read now.
JobNote read_note(const std::filesystem::path& file);

/// What this process has seen of the claims of others.
class JobClaims {
  public:
    /// A claim that does not change for `stale_after` belongs to nobody.
    explicit JobClaims(std::chrono::milliseconds stale_after) : stale_after_(stale_after) {}

    /// Returns whether another process holds the claim.
    bool held(const std::filesystem::path& file);
    /// Takes the claim; null if another process holds it, or took it at the same moment. Throws DataError naming the
    /// file if it cannot be written.
    std::unique_ptr<JobClaim> take(const std::filesystem::path& file);
    /// Tells the others something: takes the claim from whoever has it, and adds a note to the file, which stays.
    /// Throws DataError naming the file if it cannot be written.
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
