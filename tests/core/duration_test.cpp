// SPDX-License-Identifier: Apache-2.0
#include "lib/core/duration.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"

namespace gs {
namespace {

TEST(Duration, ReadsNumbersWithUnits) {
    EXPECT_EQ(parse_duration("90s", "x"), 90);
    EXPECT_EQ(parse_duration("2ms", "x"), 0.002);
    EXPECT_EQ(parse_duration("20m", "x"), 1200);
    EXPECT_EQ(parse_duration("20min", "x"), 1200);
    EXPECT_EQ(parse_duration("1h30m", "x"), 5400);
    EXPECT_EQ(parse_duration("0.5h", "x"), 1800);
}

TEST(Duration, NamesPlaceAndTextOfAnythingElse) {
    for (const char* text :
         {"", "m", "20x", "-5s", "0s", "1h30", "30 m", "nan", "inf", "1e3s", "s20", "99999h", "1.2.3s"}) {
        try {
            parse_duration(text, "--time-limit");
            ADD_FAILURE() << text;
        } catch (const UsageError& e) {
            EXPECT_NE(std::string(e.what()).find("--time-limit: '" + std::string(text) + "'"), std::string::npos)
                << e.what();
        }
    }
}

TEST(Duration, ANumberWithoutAUnitIsAskedForOne) {
    try {
        parse_duration("5", "option time-limit");
        ADD_FAILURE() << "5 was accepted";
    } catch (const UsageError& e) {
        EXPECT_STREQ(e.what(), "option time-limit: 5 of what? Write 5ms, 5s, 5m or 5h");
    }
}

TEST(Duration, IsWrittenInTheUnitsOfItsSize) {
    EXPECT_EQ(duration_text(3.21), "3.2 s");
    EXPECT_EQ(duration_text(725), "12 min 05 s");
    EXPECT_EQ(duration_text(9600), "2 h 40 min");
}

}  // namespace
}  // namespace gs
