// SPDX-License-Identifier: Apache-2.0
// Access to files that a user names. Only regular files are read, and errors of the file system are kept apart: an
// inaccessible path is an error, not a missing file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace gs {

/// Returns the reason why `path` cannot be read as an input file ("No such file or directory", "it is a named pipe
/// (FIFO), not a regular file", ...), or an empty string if it can. Never waits for a pipe or a device.
std::string input_fault(const std::filesystem::path& path);

/// Opens a regular file for reading in binary mode. Logs a debug message if `is_noted`. Throws DataError "PATH: cannot
/// be read: REASON". For files that are read in parts. The caller must check bad() after reading, because a stream ends
/// at a disk error just as it does at the end of the file.
std::ifstream open_input(const std::filesystem::path& path, bool is_noted = true);

/// Reads a whole regular file. Throws DataError as `open_input` does, also if reading fails partway.
std::string read_input(const std::filesystem::path& path);

/// Reads a UTF-8 text file without the byte order mark that editors on Windows add. Throws DataError as `read_input`
/// does, and for UTF-16, which such editors call Unicode.
std::string read_input_text(const std::filesystem::path& path);

/// Returns whether anything exists at `path`. Throws DataError "PATH: REASON" if that cannot be determined, e.g. if a
/// folder of the path may not be searched, links form a loop, or the name is too long.
bool path_exists(const std::filesystem::path& path);

/// Returns whether a folder exists at `path`. Throws as `path_exists` does.
bool folder_exists(const std::filesystem::path& path);

/// Returns the entries of a folder, sorted by name. Throws DataError "PATH: REASON" for a folder that cannot be listed.
std::vector<std::filesystem::path> list_folder(const std::filesystem::path& folder);

/// Returns the path with links and dots resolved; its last parts need not exist. Throws DataError "PATH: REASON".
std::filesystem::path canonical_path(const std::filesystem::path& path);

}  // namespace gs
