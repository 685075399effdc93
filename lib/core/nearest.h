// SPDX-License-Identifier: Apache-2.0
// "Did you mean ...": the known name that is closest to a misspelt one.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// The candidate with the smallest edit distance (insertions, deletions, replacements and swaps of neighbours each
/// cost 1; case, '-' and '_' do not count). The first of several equally near ones; empty when there is no candidate.
std::string nearest_key(const std::string& key, const std::vector<std::string>& candidates);

}  // namespace gs
