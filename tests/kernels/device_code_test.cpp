// SPDX-License-Identifier: Apache-2.0
// Which GPUs a build's code runs on, and what is said to the owners of the others.
#include "kernels/cuda/device_code.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

bool runs(const std::string& architectures, int major, int minor) {
    return why_no_code(architectures, "GPU", major, minor).empty();
}

TEST(DeviceCode, RunsWithinItsMajorVersionAndPtxOnAllLaterGpus) {
    EXPECT_TRUE(runs("sm_86", 8, 6));
    EXPECT_TRUE(runs("sm_86", 8, 9));
    EXPECT_FALSE(runs("sm_86", 8, 0));
    EXPECT_FALSE(runs("sm_80", 9, 0));
    EXPECT_FALSE(runs("sm_90+PTX", 8, 9)) << "what was the default, on an RTX 40";
    EXPECT_TRUE(runs("sm_80+PTX", 8, 6));
    EXPECT_TRUE(runs("sm_80+PTX", 12, 0));
    EXPECT_TRUE(runs("compute_80", 9, 0));
    EXPECT_FALSE(runs("compute_90", 8, 0));
    EXPECT_FALSE(runs("sm_90a", 10, 0));
    EXPECT_FALSE(runs("sm_100 sm_120", 9, 0));
    EXPECT_TRUE(runs("sm_80 sm_90 sm_120+PTX", 9, 0));
    EXPECT_TRUE(runs("native", 9, 0)) << "only a kernel can tell";
}

TEST(DeviceCode, NamesTheGpuTheBuildAndTheCommandThatMendsIt) {
    const std::string why = why_no_code("sm_90+PTX", "NVIDIA GeForce RTX 3090", 8, 6);
    EXPECT_NE(why.find("NVIDIA GeForce RTX 3090 (sm_86) cannot run this gsapp, which was built for sm_90+PTX"),
              std::string::npos)
        << why;
    EXPECT_NE(why.find("-DCMAKE_CUDA_ARCHITECTURES=86"), std::string::npos) << why;
}

TEST(DeviceCode, SaysThatAGpuIsTooOldAndOffersNoBuildForIt) {
    const std::string why = why_no_code("sm_80+PTX", "Tesla T4", 7, 5);
    EXPECT_NE(why.find("Tesla T4 (sm_75) is older"), std::string::npos) << why;
    EXPECT_EQ(why.find("CMAKE_CUDA_ARCHITECTURES"), std::string::npos) << why;
}

}  // namespace
}  // namespace gs
