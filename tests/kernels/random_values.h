// SPDX-License-Identifier: Apache-2.0
// Seeded numbers.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/base/rng.h"

namespace gs::test {

inline std::vector<float> random_values(std::size_t count, std::uint64_t seed, float low, float high) {
    std::vector<float> values(count);
    for (std::size_t i = 0; i < count; ++i)
        values[i] = low + (high - low) * uniform_from_bits(philox(seed, RngStream::kScene, i, 0).v[0]);
    return values;
}

}  // namespace gs::test
