// SPDX-License-Identifier: Apache-2.0
// Temporary files and folders beside what they are going to replace, and the removal of those that a killed program
// left. Their names have the form `.NAME.PID-N.tmp`; they are hidden, so that scans of folders ignore them.
#pragma once

#include <filesystem>

namespace gs {

/// A new temporary file. Its writer holds a lock (flock) on `fd` until it closes it; the system gives the lock back
/// when a program is killed. By this the leftovers of dead writers are told from the files of living ones.
struct TemporaryFile {
    std::filesystem::path path;
    int fd = -1;  ///< open for writing
};

/// Creates a temporary file in the folder of `target`, so that a rename stays within one file system. The first call
/// for a folder removes what killed programs left in it. Missing parent folders are created. Throws DataError naming
/// `target`.
TemporaryFile create_temporary_file(const std::filesystem::path& target);

/// A temporary folder beside `target`, locked and cleaned up as temporary files are. The destructor removes it with all
/// that is still in it.
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

/// Returns a folder in the system's place for temporary files that belongs to this user alone; WorkFolders in it stand
/// beside nothing that is kept. Throws DataError if the name is somebody else's.
std::filesystem::path own_temporary_folder();

/// Removes files and folders `.NAME.PID-N.tmp` of this user in `folder` that no living program holds. Errors are
/// ignored: a leftover harms nobody.
void remove_leftovers(const std::filesystem::path& folder);

/// Makes names that were created, renamed or removed in `folder` survive a power cut (fsync). Throws DataError naming
/// `target`, unless the file system or the folder's permissions do not allow it for a folder.
void sync_folder(const std::filesystem::path& folder, const std::filesystem::path& target);

/// Creates the folder and its missing parents durably. Throws DataError naming `target`.
void create_folders(const std::filesystem::path& folder, const std::filesystem::path& target);

/// Throws the DataError of a failed system call: what could not be done with `path`, the reason, and what to do.
[[noreturn]] void fail_to_write(const char* action, const std::filesystem::path& path, int error);

}  // namespace gs
