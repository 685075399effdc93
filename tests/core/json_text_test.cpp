// SPDX-License-Identifier: Apache-2.0
// JSON that would be taken for something else, or end the program, is refused.
#include "lib/core/json_text.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "lib/core/utf8.h"

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

TEST(JsonText, NamesThatAreNotUtf8ComeBackByteForByte) {
    std::string all;
    for (int c = 1; c < 256; ++c) all += char(c);
    const std::vector<std::string> names = {"im\xE0",
                                            "im\xE1",
                                            "im\xEF\xBF\xBD",
                                            "caf\xC3\xA9\xE9",
                                            "\xED\xB3\xA0",
                                            "\\udce0",
                                            "\\\xE0",
                                            std::string("\0e0\xE0", 4),
                                            all};
    std::set<std::string> texts;
    for (const std::string& name : names) {
        nlohmann::ordered_json json = {{"image", name}, {"list", {1, name}}};
        json[name] = true;
        const std::string text = json_text(json, 1);
        EXPECT_TRUE(is_utf8(text)) << text;
        texts.insert(text);
        EXPECT_EQ(try_parse_ordered_json(text), json) << text;
        EXPECT_EQ(parse_json(text).at("image"), name);
    }
    EXPECT_EQ(texts.size(), names.size());
    EXPECT_EQ(json_text(nlohmann::json("im\xE0")), R"("im\udce0")") << "as Python's json.dumps writes os.fsdecode";
}

TEST(JsonText, PairsOfSurrogatesStayCharacters) {
    EXPECT_EQ(parse_json(R"("\ud83d\udc80 \uDCE9")"), "\xF0\x9F\x92\x80 \xE9");
    EXPECT_EQ(parse_json(R"("\\udce9")"), "\\udce9") << "an escaped backslash begins no escape";
    EXPECT_THROW(parse_json(R"("\ud83d")"), nlohmann::json::exception);
    EXPECT_THROW(parse_json(R"({"\udce9": 1, "\udcE9": 2})"), nlohmann::json::exception) << "one key, twice";
}

}  // namespace
}  // namespace gs
