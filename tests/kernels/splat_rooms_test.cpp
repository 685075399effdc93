// SPDX-License-Identifier: Apache-2.0
#include "kernels/ranks/shard.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

std::uint64_t share(double of_all) { return SplatRooms::share(std::uint64_t(of_all * 1000), 1000); }

TEST(SplatRooms, HoldWhatTheViewHadAndALittleMore) {
    SplatRooms rooms;
    rooms.note(3, share(0.5));
    EXPECT_GE(rooms.room(3, 1000), 562u) << "an eighth";
    EXPECT_LE(rooms.room(3, 1000), 579u);
    rooms.note(3, share(0.1));
    EXPECT_LE(rooms.room(3, 1000), 129u) << "it follows the training";
}

TEST(SplatRooms, TakeOtherViewsForThoseThatTheyDoNotKnow) {
    SplatRooms rooms;
    EXPECT_LT(rooms.room(0, 1000000), 300000u);
    rooms.note(7, share(0.8));
    for (const std::int64_t view : {-1, 0}) EXPECT_GE(rooms.room(view, 1000), 800u);
    rooms.note(-1, share(0.9));
    EXPECT_GE(rooms.room(-1, 1000), 900u);
    EXPECT_LE(rooms.room(7, 1000), 917u);
}

TEST(SplatRooms, AreNeverMoreThanThereAreRows) {
    SplatRooms rooms;
    rooms.note(0, share(1));
    for (const std::int64_t rows : {0, 1, 15, 1000}) EXPECT_EQ(rooms.room(0, rows), std::size_t(rows));
}

TEST(SplatRooms, HoldAllThatWasNotedInSmallModels) {
    for (std::int64_t rows = 1; rows < 300; ++rows)
        for (std::int64_t shown = 0; shown <= rows; ++shown) {
            SplatRooms rooms;
            rooms.note(0, SplatRooms::share(std::uint64_t(shown), rows));
            ASSERT_GE(rooms.room(0, rows), std::size_t(shown)) << rows;
        }
}

TEST(SplatRooms, HoldAllOfTwoThousandMillion) {
    SplatRooms rooms;
    constexpr std::int64_t kMost = 0x7fffffff;
    rooms.note(0, SplatRooms::share(kMost - 1, kMost));
    EXPECT_EQ(rooms.room(0, kMost), std::size_t(kMost));
    EXPECT_EQ(SplatRooms::share(0, 0), 0u);
}

}  // namespace
}  // namespace gs
