// SPDX-License-Identifier: Apache-2.0
// Finds the nearest name by edit distance.
#include "lib/core/nearest.h"

#include <algorithm>
#include <cctype>

namespace gs {
namespace {

std::string folded(const std::string& text) {
    std::string out;
    for (const unsigned char c : text) {
        if (c != '-' && c != '_') out.push_back(static_cast<char>(std::tolower(c)));
    }
    return out;
}

/// Returns the restricted Damerau-Levenshtein distance; only three rows of the table are kept.
std::size_t edit_distance(const std::string& a, const std::string& b) {
    std::vector<std::size_t> before(b.size() + 1), previous(b.size() + 1), current(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j) previous[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
        current[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            current[j] =
                std::min({previous[j] + 1, current[j - 1] + 1, previous[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
            const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
            if (swapped) current[j] = std::min(current[j], before[j - 2] + 1);
        }
        before.swap(previous);
        previous.swap(current);
    }
    return previous[b.size()];
}

}  // namespace

std::string nearest_key(const std::string& key, const std::vector<std::string>& candidates) {
    std::string best;
    // Up to a third of the letters may be wrong. A key with more errors is not taken for a misspelt candidate.
    const std::string wanted = folded(key);
    std::size_t best_distance = std::max<std::size_t>(1, wanted.size() / 3) + 1;
    for (const std::string& candidate : candidates) {
        const std::size_t distance = edit_distance(wanted, folded(candidate));
        if (distance < best_distance) {
            best_distance = distance;
            best = candidate;
        }
    }
    return best;
}

std::string did_you_mean(const std::string& key, const std::vector<std::string>& candidates) {
    const std::string nearest = nearest_key(key, candidates);
    return nearest.empty() ? "" : "; did you mean '" + nearest + "'?";
}

}  // namespace gs
