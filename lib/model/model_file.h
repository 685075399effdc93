// SPDX-License-Identifier: Apache-2.0
// Recognises files of other programs, for messages that name their kind and a way to convert them to a model.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// Returns the reason why a file or folder cannot be read as a model, with advice, as a sentence that begins with "it
/// is": "it is an .spz file, which gsapp does not read; this command makes one that it reads: ...". The kind follows
/// from the first bytes, and from the name only if they are inconclusive. Returns an empty text for a .ply of
/// Gaussians, for other folders, and for files that cannot be opened.
std::string other_model(const std::filesystem::path& path);

/// Throws DataError "cannot read 'PATH': ..." with the text of other_model() if that is not empty.
void require_model_file(const std::filesystem::path& path);

}  // namespace gs
