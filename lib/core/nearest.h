// SPDX-License-Identifier: Apache-2.0
// Finds the known name closest to a misspelt one, for messages like "did you mean ...".
#pragma once

#include <string>
#include <vector>

namespace gs {

/// Returns the candidate with the smallest edit distance to `key`, the first in case of a tie. Returns an empty string
/// without candidates, or if the distance is more than 1 and more than a third of the letters of `key`. Insertions,
/// deletions, replacements and swaps of adjacent letters each cost 1; case, '-' and '_' are ignored.
std::string nearest_key(const std::string& key, const std::vector<std::string>& candidates);

/// Returns "; did you mean 'NAME'?" with the result of nearest_key(), or an empty string if that is empty.
std::string did_you_mean(const std::string& key, const std::vector<std::string>& candidates);

}  // namespace gs
