// SPDX-License-Identifier: Apache-2.0
// Finds the known name that is closest to a misspelt one, for messages like "did you mean ...".
#pragma once

#include <string>
#include <vector>

namespace gs {

/// Returns the candidate with the smallest edit distance, the first of several; an empty string without candidates.
/// Insertions, deletions, replacements and swaps of neighbours each cost 1; case, '-' and '_' do not count.
std::string nearest_key(const std::string& key, const std::vector<std::string>& candidates);

}  // namespace gs
