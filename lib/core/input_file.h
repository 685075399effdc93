// SPDX-License-Identifier: Apache-2.0
// The ways to files that a user names. Only regular files are read, and no answer of the file system is taken for
// another: what cannot be looked at is an error, not something that is missing.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace gs {

/// Returns why `path` cannot be read as an input file ("No such file or directory", "it is a named pipe (FIFO), not a
/// regular file", ...), and an empty string if it can. Never waits for a pipe or a device.
std::string input_fault(const std::filesystem::path& path);

/// Opens a regular file for reading, in binary mode, and says so in a message if `is_noted`. Throws DataError
/// "PATH: cannot be read: REASON". It is for files that are read in parts: whoever reads them must look at bad()
/// afterwards, because a stream ends at an error of the disk as it does at the end of the file.
std::ifstream open_input(const std::filesystem::path& path, bool is_noted = true);

/// Reads a whole regular file. Throws DataError as `open_input` does, also when reading fails half way.
std::string read_input(const std::filesystem::path& path);

/// Reads a text in UTF-8 without the byte order mark that editors on Windows put before it. Throws DataError as
/// `read_input` does, and for UTF-16, which such editors call Unicode.
std::string read_input_text(const std::filesystem::path& path);

/// Returns whether there is anything under this name. Throws DataError "PATH: REASON" if the system cannot tell: a
/// folder on the way may not be searched, links form a loop, the name is too long.
bool path_exists(const std::filesystem::path& path);

/// Returns whether there is a folder under this name. Throws as `path_exists` does.
bool folder_exists(const std::filesystem::path& path);

/// Returns the entries of a folder, sorted by name. Throws DataError "PATH: REASON" for what cannot be listed.
std::vector<std::filesystem::path> list_folder(const std::filesystem::path& folder);

/// Returns the path without links and dots; its last parts need not exist. Throws DataError "PATH: REASON".
std::filesystem::path canonical_path(const std::filesystem::path& path);

}  // namespace gs
