// SPDX-License-Identifier: Apache-2.0
// JSON that would be taken for something else, or end the program, is refused.
#include "lib/core/json_text.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

std::string refusal(const std::string& text) {
    try {
        parse_json(text);
    } catch (const nlohmann::json::exception& e) {
        return e.what();
    }
    return "";
}

TEST(JsonText, KeysStandOnceInAnObject) {
    EXPECT_NE(refusal(R"({"a": 1, "b": {"a": 2, "a": 3}})").find("\"a\" stands twice"), std::string::npos);
    EXPECT_EQ(refusal(R"({"a": [{"a": 1}, {"a": 2}], "b": {"a": {}}})"), "");
    EXPECT_TRUE(try_parse_json(R"({"a": 1, "a": 2})").is_discarded());
}

TEST(JsonText, DeepNestingIsRefusedBeforeItOverflowsTheStack) {
    constexpr std::size_t kDeep = 300000;
    EXPECT_NE(refusal(std::string(kDeep, '[') + std::string(kDeep, ']')).find("nested deeper"), std::string::npos);
    EXPECT_TRUE(try_parse_ordered_json(std::string(kDeep, '[')).is_discarded());
    const std::string shallow = std::string(90, '[') + std::string(90, ']');
    EXPECT_EQ(json_text(parse_json(shallow)), shallow);
}

TEST(JsonText, LongListsTakeNoLongTime) {
    std::string text = "[{}";
    for (int i = 0; i < 200000; ++i) text += ",{}";
    EXPECT_EQ(parse_json(text + "]").size(), 200001u);
}

TEST(JsonText, CommentsAreTakenWhereTheyAreAllowed) {
    const std::string text = "{\"a\": 1 // one\n}";
    EXPECT_EQ(parse_json(text, true).at("a"), 1);
    EXPECT_THROW(parse_json(text), nlohmann::json::exception);
}

}  // namespace
}  // namespace gs
