// SPDX-License-Identifier: Apache-2.0
// Runs the tests of a program, and returns 77 where all of them were skipped, which ctest reports as such.
#include <gtest/gtest.h>

int main(int argc, char** argv) {
    testing::InitGoogleTest(&argc, argv);
    const int status = RUN_ALL_TESTS();
    const testing::UnitTest& tests = *testing::UnitTest::GetInstance();
    const bool skipped = tests.skipped_test_count() > 0 && tests.successful_test_count() == 0;
    return status == 0 && skipped ? 77 : status;
}
