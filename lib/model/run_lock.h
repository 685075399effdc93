// SPDX-License-Identifier: Apache-2.0
// Keeps a run folder to one run at a time, and notices when the folder is gone.
#pragma once

#include <filesystem>

namespace gs {

/// A lock on a run folder (flock on its file .gsapp.lock). The system releases it when the process ends, however that
/// happens, so a file that a killed run left behind locks nothing.
class RunLock {
  public:
    /// Creates the folder if it is missing, and locks it. Throws UsageError naming folder and process when another run
    /// holds the lock, DataError when the folder cannot be created or written. File systems without locks get a
    /// warning instead.
    explicit RunLock(std::filesystem::path folder);
    /// Removes the file and releases the lock.
    ~RunLock();
    RunLock(const RunLock&) = delete;
    RunLock& operator=(const RunLock&) = delete;

    /// Returns whether a run holds the lock of the folder. False where there is no such folder, or no locks.
    static bool is_held(const std::filesystem::path& folder);

    /// Throws DataError unless the path still leads to the folder that was locked. A run that wrote on after its folder
    /// was removed would leave half of its files in a new one.
    void check_folder() const;

  private:
    void lock_file();

    std::filesystem::path folder_;
    int folder_fd_ = -1, file_fd_ = -1;
};

}  // namespace gs
