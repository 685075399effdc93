// SPDX-License-Identifier: Apache-2.0
// The values that a choice of range has to consider: rows sampled from a model, and the possible ends.
#include "appearance/code_range.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace gs {
namespace {

constexpr std::int64_t kLargest = 10000, kOthers = 10000;

}  // namespace

std::vector<SampledRow> sample_rows(const GroupArrays<float>& group, int first, int count) {
    const std::int64_t n = std::int64_t(group.param.size()) / group.width;
    std::vector<float> key(static_cast<std::size_t>(n));
    for (std::int64_t i = 0; i < n; ++i) {
        const float* row = group.param.data() + i * group.width + first;
        for (int k = 0; k < count; ++k) key[std::size_t(i)] = std::max(key[std::size_t(i)], std::abs(row[k]));
    }
    std::vector<std::int64_t> rows(static_cast<std::size_t>(n));
    std::iota(rows.begin(), rows.end(), 0);
    const auto larger = [&](std::int64_t a, std::int64_t b) {
        const float x = key[std::size_t(a)], y = key[std::size_t(b)];
        return x != y ? x > y : a < b;
    };
    const auto middle = rows.begin() + std::min(n, kLargest);
    std::nth_element(rows.begin(), middle, rows.end(), larger);
    std::sort(middle, rows.end());
    std::vector<SampledRow> sample;
    for (auto row = rows.begin(); row != middle; ++row) sample.push_back({*row, 1});
    const std::int64_t rest = rows.end() - middle, others = std::min(rest, kOthers);
    for (std::int64_t k = 0; k < others; ++k)
        sample.push_back({middle[k * rest / others], double(rest) / double(others)});
    return sample;
}

std::vector<float> possible_ends(const std::vector<float>& values) {
    std::vector<float> ends = {values.front()};
    for (std::size_t outside = 1; outside < values.size() / 4; outside *= 2) ends.push_back(values[outside]);
    return ends;
}

}  // namespace gs
