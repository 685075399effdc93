// SPDX-License-Identifier: Apache-2.0
// Creates temporary files and folders beside the files that they will replace, and removes the leftovers of killed
// programs. Their names have the form `.NAME.PID-N.tmp`; they are hidden, so that scans of folders ignore them.
#pragma once

#include <filesystem>

namespace gs {

/// A new temporary file. Its writer holds a lock (flock) on `fd` until it closes `fd`; the system releases the lock if
/// the program is killed. The lock distinguishes the files of running writers from the leftovers of dead ones.
struct TemporaryFile {
    std::filesystem::path path;
    int fd = -1;  ///< open for writing
};

/// Creates a temporary file in the folder of `target`, so that a rename stays within one file system. The first call
/// for a folder removes the leftovers of killed programs from it. Missing parent folders are created. Throws DataError
/// naming `target`.
TemporaryFile create_temporary_file(const std::filesystem::path& target);

/// A temporary folder beside `target`, locked and cleaned up as temporary files are. The destructor removes it with its
/// remaining contents.
class WorkFolder {
  public:
    /// Throws DataError naming `target`.
    explicit WorkFolder(const std::filesystem::path& target);
    ~WorkFolder();
    WorkFolder(const WorkFolder&) = delete;
    WorkFolder& operator=(const WorkFolder&) = delete;

    const std::filesystem::path& path() const { return path_; }

  private:
    std::filesystem::path path_;
    int fd_ = -1;
};

/// Returns a folder in the system's temporary folder that belongs to this user alone, for WorkFolders that are not
/// renamed to a permanent target. Throws DataError if another user owns the name.
std::filesystem::path own_temporary_folder();

/// Removes files and folders `.NAME.PID-N.tmp` of this user in `folder` that no running program locks. Errors are
/// ignored, because leftovers are harmless.
void remove_leftovers(const std::filesystem::path& folder);

/// Flushes names created, renamed or removed in `folder` to disk (fsync), so that they survive a power cut. Throws
/// DataError naming `target`, except if the file system or the folder's permissions do not allow fsync of a folder.
void sync_folder(const std::filesystem::path& folder, const std::filesystem::path& target);

/// Creates the folder and its missing parents durably. Throws DataError naming `target`.
void create_folders(const std::filesystem::path& folder, const std::filesystem::path& target);

/// Throws the DataError of a failed system call: the failed action on `path`, the reason, and a remedy.
[[noreturn]] void fail_to_write(const char* action, const std::filesystem::path& path, int error);

}  // namespace gs
