// SPDX-License-Identifier: Apache-2.0
// Sums of rows of which some are not written. Skipped where there is no device.
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "tests/gpu/gpu_test.h"
#include "tests/gpu/sums/sums_on_device.h"

namespace gs::test {
namespace {

using GpuSums = Gpu;

TEST_F(GpuSums, LeaveOutRowsThatAreNotWritten) {
    std::mt19937 rng(5);
    std::uniform_int_distribution<int> digit(-8, 8);  // sums of these are exact
    for (const int rows : {0, 1, 63, 64, 4095, 4096, 4097, 20'000})
        for (const int width : {1, 8, 19}) {
            std::vector<float> values, expected(std::size_t(width), 0.0f);
            std::vector<std::uint8_t> is_set;
            for (int row = 0; row < rows; ++row) {
                is_set.push_back(digit(rng) > 0);
                for (int column = 0; column < width; ++column) {
                    const float x = float(digit(rng));
                    values.push_back(is_set.back() ? x : std::numeric_limits<float>::quiet_NaN());
                    if (is_set.back()) expected[std::size_t(column)] += x;
                }
            }
            EXPECT_EQ(sum_on_device(values, is_set, width), expected) << rows << " rows of " << width;
        }
}

}  // namespace
}  // namespace gs::test
