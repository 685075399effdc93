// SPDX-License-Identifier: Apache-2.0
// Recognises files of other programs, so that a message can say what they are and what makes a model of them.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// Returns what keeps a file or folder from being read as a model, as a sentence that begins with "it is", with what to
/// do about it: "it is an .spz file, which gsapp does not read; this command makes one that it reads: ...". It goes by
/// the first bytes, and by the name only if they say nothing. Empty for a .ply of Gaussians, for other folders, and
/// for what cannot be opened.
std::string other_model(const std::filesystem::path& path);

/// Throws DataError "cannot read 'PATH': ..." if other_model has something to say.
void require_model_file(const std::filesystem::path& path);

}  // namespace gs
