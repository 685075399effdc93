// SPDX-License-Identifier: Apache-2.0
// A device that answers runs a first kernel of this build, and says what it is.
#include "tests/gpu/gpu_test.h"

namespace gs::test {
namespace {

TEST_F(Gpu, RunsAFirstKernelOfThisBuildAndIsAvailableAfterIt) {
    EXPECT_EQ(try_cuda_device(), "");
    EXPECT_TRUE(cuda_available()) << cuda_unavailable_reason();
    EXPECT_GT(cuda_device_count(), 0);
    EXPECT_NE(cuda_driver_description().find("(sm_"), std::string::npos) << cuda_driver_description();
}

}  // namespace
}  // namespace gs::test
