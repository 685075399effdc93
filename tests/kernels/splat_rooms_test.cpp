// SPDX-License-Identifier: Apache-2.0
#include "kernels/ranks/splat_rooms.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

TEST(SplatRooms, HoldWhatTheViewHadAndALittleMore) {
    SplatRooms rooms;
    rooms.note(3, 0.5);
    EXPECT_GE(rooms.room(3, 1000), 520u);
    EXPECT_LE(rooms.room(3, 1000), 560u);
    rooms.note(3, 0.1);
    EXPECT_LE(rooms.room(3, 1000), 125u) << "it follows the training";
}

TEST(SplatRooms, TakeOtherViewsForThoseThatTheyDoNotKnow) {
    SplatRooms rooms;
    EXPECT_LT(rooms.room(0, 1000000), 300000u);
    rooms.note(7, 0.8);
    for (const std::int64_t view : {-1, 0}) EXPECT_GE(rooms.room(view, 1000), 800u);
    rooms.note(-1, 0.9);
    EXPECT_GE(rooms.room(-1, 1000), 900u);
    EXPECT_LE(rooms.room(7, 1000), 870u);
}

TEST(SplatRooms, AreNeverMoreThanThereAreRows) {
    SplatRooms rooms;
    rooms.note(0, 1);
    for (const std::int64_t rows : {0, 1, 15, 1000}) EXPECT_EQ(rooms.room(0, rows), std::size_t(rows));
}

TEST(SplatRooms, HoldAllThatWasNotedInSmallModels) {
    for (std::int64_t rows = 1; rows < 300; ++rows)
        for (std::int64_t shown = 0; shown <= rows; ++shown) {
            SplatRooms rooms;
            rooms.note(0, double(shown) / double(rows));
            ASSERT_GE(rooms.room(0, rows), std::size_t(shown)) << rows;
        }
}

}  // namespace
}  // namespace gs
