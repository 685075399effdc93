// SPDX-License-Identifier: Apache-2.0
// Shares cells among processes, also of several machines, that see the same folders.
//
// Whoever trains a cell holds a file beside its folder, which was created exclusively and whose time is renewed while
// the process lives. A file that is no longer renewed belongs to a process that is gone, and another takes its place.
// No clocks are compared: each process judges by its own how long a file has not changed.
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
class CellClaim {
  public:
    CellClaim(std::filesystem::path file, std::string owner, std::chrono::milliseconds renew_every);
    ~CellClaim();
    CellClaim(const CellClaim&) = delete;
    CellClaim& operator=(const CellClaim&) = delete;

    /// Whether another process took the claim, since this one seemed to be gone.
    bool lost() const;

  private:
    void renew();

    const std::filesystem::path file_;
    const std::string owner_;
    const std::chrono::milliseconds renew_every_;
    mutable std::mutex mutex_;
    std::condition_variable wake_;
    bool ends_ = false, lost_ = false;  ///< guarded by mutex_
    std::thread renewer_;
};

/// What this process has seen of the claims of others.
class CellClaims {
  public:
    /// A claim that does not change for `stale_after` belongs to nobody.
    explicit CellClaims(std::chrono::milliseconds stale_after) : stale_after_(stale_after) {}

    /// Returns whether another process holds the claim.
    bool held(const std::filesystem::path& file);
    /// Takes the claim; null if another process holds it, or took it at the same moment. Throws DataError naming the
    /// file if it cannot be written.
    std::unique_ptr<CellClaim> take(const std::filesystem::path& file);

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
