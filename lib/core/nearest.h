// SPDX-License-Identifier: Apache-2.0
// Finds the known name that is closest to a misspelt one, for messages like "did you mean ...".
#pragma once

#include <string>
#include <vector>

namespace gs {

/// Returns the candidate with the smallest edit distance, the first of several; an empty string where even that is more
/// than a third of the letters of `key` (and more than 1), or if there are no candidates.
/// Insertions, deletions, replacements and swaps of neighbours each cost 1; case, '-' and '_' do not count.
std::string nearest_key(const std::string& key, const std::vector<std::string>& candidates);

/// Returns "; did you mean 'NAME'?" with that candidate, or an empty string.
std::string did_you_mean(const std::string& key, const std::vector<std::string>& candidates);

}  // namespace gs
