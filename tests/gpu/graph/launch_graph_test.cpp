// SPDX-License-Identifier: Apache-2.0
// Kernels that are launched together: their order, changes of a graph, and failures. Skipped where there is no device.
#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/gpu/gpu_test.h"
#include "tests/gpu/graph/graph_on_device.h"

namespace gs::test {
namespace {

using GpuGraph = Gpu;

TEST_F(GpuGraph, LaunchesInOrderWithNewArgumentsAndInNewShapes) {
    NumberOnDevice number;
    number.append_together({1, 2});
    number.append_together({3, 4});     // other arguments
    number.append(5);                   // between two graphs
    number.append_together({6, 7, 8});  // another shape
    number.append_together({});
    number.append_together({9});
    EXPECT_EQ(number.read(), 123456789);
}

TEST_F(GpuGraph, WhatThrowsLaunchesNothingAndTheStreamGoesOn) {
    NumberOnDevice number;
    const auto fail = [] { throw std::runtime_error("no"); };
    EXPECT_THROW(number.append_together({1}, fail), std::runtime_error);
    number.append_together({2, 3});
    EXPECT_THROW(number.append_together({4, 5}, fail), std::runtime_error);
    number.append(6);
    number.append_together({7, 8});
    EXPECT_EQ(number.read(), 23678);
}

TEST_F(GpuGraph, WaitingWithinFailsAndTheStreamGoesOn) {
    NumberOnDevice number;
    EXPECT_THROW(number.append_together({1}, [&] { number.read(); }), std::runtime_error);
    number.append_together({2});
    EXPECT_EQ(number.read(), 2);
}

}  // namespace
}  // namespace gs::test
