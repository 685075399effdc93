// SPDX-License-Identifier: Apache-2.0
// ppisp.json: every float comes back, and damage is named.
#include "lib/model/ppisp_json.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "kernels/base/rng.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

/// Returns PPISP of 3 frames and 2 cameras; all numbers are random, some of them extreme.
PpispFile sample(bool controllers) {
    PpispFile file;
    file.iteration = 30000;
    file.exif = true;
    file.mean_exif = -7.25;
    file.frames = {{"a \"quoted\".jpg", 0, -7.5}, {"b/c.jpg", 1}, {"d.jpg", 1, 0.125}};
    file.state = identity_ppisp(3, 2);
    if (controllers) file.state.controller.resize(2 * std::size_t(kControllerWeights));
    std::uint32_t n = 0;
    for (auto* values : {&file.state.param, &file.state.controller})
        for (float& value : *values) value = uniform_from_bits(philox(1, RngStream::kScene, 0, n++).v[0]) - 0.5f;
    file.state.param[1] = 1.17549435e-38f;
    file.state.param[2] = -3.40282347e38f;
    return file;
}

TEST(PpispJson, EveryNumberComesBackBitForBit) {
    const test::TemporaryFolder folder;
    for (const bool controllers : {false, true}) {
        const PpispFile file = sample(controllers);
        write_ppisp_json(folder.path() / "ppisp.json", file);
        const PpispFile back = read_ppisp_json(folder.path() / "ppisp.json");
        EXPECT_EQ(back.iteration, 30000);
        EXPECT_TRUE(back.exif);
        EXPECT_EQ(back.mean_exif, -7.25);
        EXPECT_EQ(back.state.num_frames, 3);
        EXPECT_EQ(back.state.num_cameras, 2);
        EXPECT_EQ(back.state.param, file.state.param);
        EXPECT_EQ(back.state.controller, file.state.controller);
        ASSERT_EQ(back.frames.size(), 3u);
        for (std::size_t k = 0; k < 3; ++k) {
            EXPECT_EQ(back.frames[k].image, file.frames[k].image);
            EXPECT_EQ(back.frames[k].camera, file.frames[k].camera);
            EXPECT_EQ(back.frames[k].exif_exposure, file.frames[k].exif_exposure);
        }
    }
}

class Damage : public ::testing::Test {
  protected:
    Damage() {
        write_ppisp_json(path_, sample(false));
        std::ifstream in(path_);
        text_.assign(std::istreambuf_iterator<char>(in), {});
        json_ = parse_json(text_);
    }
    std::string error_of(const std::string& text) {
        folder_.write("ppisp.json", text);
        try {
            read_ppisp_json(path_);
        } catch (const DataError& e) {
            return e.what();
        }
        return "";
    }
    void expect_error(const nlohmann::json& json, const std::string& part) {
        const std::string error = error_of(json_text(json));
        EXPECT_NE(error.find(part), std::string::npos) << error;
        EXPECT_NE(error.find("ppisp.json"), std::string::npos) << error;
    }

    test::TemporaryFolder folder_;
    const std::filesystem::path path_ = folder_.path() / "ppisp.json";
    std::string text_;
    nlohmann::json json_;
};

TEST_F(Damage, TruncatedFilesAreNeverRead) {
    EXPECT_EQ(error_of(text_), "");
    for (std::size_t length = 0; length + 3 < text_.size(); length += 41)
        EXPECT_NE(error_of(text_.substr(0, length)).find("truncated"), std::string::npos) << length;
    EXPECT_THROW(read_ppisp_json(folder_.path() / "missing.json"), DataError);
}

TEST_F(Damage, IsNamed) {
    using nlohmann::json;
    const auto changed = [&](const char* pointer, const json& value) {
        json copy = json_;
        copy[json::json_pointer(pointer)] = value;
        return copy;
    };
    expect_error(changed("/version", 2), "version is 2, but this program reads 1");
    expect_error(changed("/version", "1"), "version");
    expect_error(changed("/cameras", json::array()), "at least one camera");
    expect_error(changed("/cameras/0/vignetting/1", {1, 2, 3}), "cameras[0].vignetting[1]: 3 numbers, expected 5");
    expect_error(changed("/cameras/1/response", {1}), "1 channels, expected 3");
    expect_error(changed("/cameras/0/controller", {1, 2}), "2 numbers, expected 241961");
    expect_error(changed("/cameras/1/controller", json::array()), "either all cameras have a controller or none");
    expect_error(changed("/frames/2/color/7", "x"), "frames[2].color[7]");
    expect_error(changed("/frames/2/exposure", 1e39), "not a finite number");
    expect_error(changed("/frames/2/exposure", nullptr), "not a finite number");
    expect_error(changed("/frames/1/camera", 2), "frames[1].camera: 2 is not a whole number in 0..1");
    expect_error(changed("/frames/1/image", 3), "text is expected");
    expect_error(changed("/frames", 3), "a list is expected");
    json without = json_;
    without.erase("frames");
    expect_error(without, "'frames' is missing");
    expect_error(json::array(), "'version' is missing");
    EXPECT_NE(error_of("{\"version\": NaN}").find("not valid JSON"), std::string::npos);
}

TEST_F(Damage, ManyEmptyCamerasTakeNoMemoryForTheirControllers) {
    nlohmann::json json = json_;
    json["cameras"][0]["controller"] = nlohmann::json::array();
    // 400,000 controllers would take 387 GB.
    for (int i = 0; i < 400000; ++i) json["cameras"].push_back(nlohmann::json::object());
    expect_error(json, "cameras[0].controller: 0 numbers, expected 241961");
}

}  // namespace
}  // namespace gs
