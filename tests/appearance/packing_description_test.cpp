// SPDX-License-Identifier: Apache-2.0
// What packing.json may say, and what it says of this program's models.
#include "appearance/packing.h"

#include <gtest/gtest.h>

#include "appearance/model_info.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

double value(const std::string& text) { return evaluate_expression(text, {{"n", 9}, {"bands", 14}}); }

// The same cases as in apps/viewer/test/format.test.ts.
TEST(Expression, HasTheUsualMeaning) {
    EXPECT_EQ(value("1 + 2 * 3 - 4"), 3);
    EXPECT_EQ(value("(1 + 2) * 3 % 4"), 1);
    EXPECT_EQ(value("(n + 7) / 8 * 8"), 16);
    EXPECT_EQ(value("n >= 9 && n != 10 || 0"), 1);
    EXPECT_EQ(value("!n ? 1 : n == 9 ? 2 : 3"), 2);
    EXPECT_EQ(value("bands / 2 % 2 + (bands >= 8)"), 2);
}

TEST(Expression, RefusesWhatItCannotUnderstand) {
    for (const char* text : {"", "1 +", "(1", "1 2", "m", "1 ? 2", "1.5"}) EXPECT_THROW(value(text), DataError) << text;
}

TEST(PackingDescription, EveryModelHasOne) {
    for (const ModelInfo* model : appearance_models()) {
        SCOPED_TRACE(model->name);
        ASSERT_TRUE(model->packing);
        const PackingDescription& d = *model->packing->description;
        EXPECT_EQ(&packing_description(d.id), &d);
        PackedHeader header;
        header.model = d.id, header.neurons = 16, header.hidden_layers = 2;
        EXPECT_NO_THROW(packed_layout(header));
    }
    EXPECT_THROW(packing_description(7), DataError);
    EXPECT_THROW(packing_description("phong"), DataError);
}

TEST(PackingDescription, SizesFollowFromTheHeader) {
    PackedHeader header;
    header.model = packing_description("sh").id, header.bands = 0xe;
    EXPECT_EQ(packed_layout(header).texture_words, (std::vector<int>{2, 4, 4}));
    header.bands = 0;
    EXPECT_TRUE(packed_layout(header).texture_words.empty());
    header.model = packing_description("nasgabor").id, header.features = 2;
    EXPECT_EQ(packed_layout(header).texture_words, (std::vector<int>{4, 4, 4, 4})) << "26 halves";
    header.model = packing_description("neural").id, header.features = 16, header.bands = 0xe, header.neurons = 32,
    header.hidden_layers = 2;
    EXPECT_EQ(packed_layout(header).weight_halves, 2144)
        << "16 features, the constant and 15 of the direction, all to 32 neurons, 32, 3";
}

TEST(PackingDescription, DamagedOnesNameTheFile) {
    const auto complaint = [](const std::string& text) -> std::string {
        try {
            parse_packings("appearance/x/packing.json", text);
        } catch (const DataError& e) {
            return e.what();
        }
        return "";
    };
    for (const char* text : {"", "{", "{}", R"({"id": "x", "name": "x"})", R"({"id": 8, "name": "x"})",
                             R"({"id": 5, "name": "x", "halves": 3})"})
        EXPECT_NE(complaint(text).find("appearance/x/packing.json"), std::string::npos)
            << text << ": " << complaint(text);
    EXPECT_EQ(complaint(R"([{"id": 5, "name": "x"}, {"id": 6, "name": "y", "halves": "3 * featureDim"}])"), "");
}

}  // namespace
}  // namespace gs
