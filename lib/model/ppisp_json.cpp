// SPDX-License-Identifier: Apache-2.0
// Writes and reads ppisp.json.
#include "lib/model/ppisp_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "kernels/base/portable.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

using Json = nlohmann::json;

constexpr int kVersion = 1;
constexpr int kChannels = 3, kLatents = kIspFrameValues - 1;

void write_list(std::ostream& out, const float* values, std::int64_t count) {
    out << '[';
    for (std::int64_t i = 0; i < count; ++i) out << fmt::format("{}{:.9g}", i ? "," : "", values[i]);
    out << ']';
}

/// Writes one list per channel.
void write_channels(std::ostream& out, const float* values, int width) {
    out << '[';
    for (int c = 0; c < kChannels; ++c) {
        if (c) out << ',';
        write_list(out, values + c * width, width);
    }
    out << ']';
}

/// A part of the JSON document, with its place for messages.
class Node {
  public:
    Node(const Json& json, std::string where) : json_(json), where_(std::move(where)) {}

    [[noreturn]] void fail(const std::string& what) const { throw DataError(fmt::format("{}: {}", where_, what)); }
    bool has(const char* key) const { return json_.is_object() && json_.contains(key); }
    Node at(const char* key) const {
        if (!has(key)) fail(fmt::format("'{}' is missing", key));
        return {json_.at(key), where_ + "." + key};
    }
    std::size_t size() const {
        if (!json_.is_array()) fail("a list is expected");
        return json_.size();
    }
    Node at(std::size_t i) const { return {json_.at(i), fmt::format("{}[{}]", where_, i)}; }
    std::string text() const {
        if (!json_.is_string()) fail("text is expected");
        return json_.get<std::string>();
    }
    bool flag() const {
        if (!json_.is_boolean()) fail("true or false is expected");
        return json_.get<bool>();
    }
    std::int64_t integer(std::int64_t low, std::int64_t high) const {
        if (!json_.is_number_integer() || json_.get<std::int64_t>() < low || json_.get<std::int64_t>() > high)
            fail(fmt::format("{} is not a whole number in {}..{}", json_text(json_), low, high));
        return json_.get<std::int64_t>();
    }
    float number() const {
        if (!json_.is_number() || !gs_isfinite(json_.get<float>()))
            fail(fmt::format("{} is not a finite number", json_text(json_)));
        return json_.get<float>();
    }
    void numbers(float* out, std::size_t count) const {
        if (size() != count) fail(fmt::format("{} numbers, expected {}", json_.size(), count));
        for (std::size_t i = 0; i < count; ++i) out[i] = at(i).number();
    }
    void channels(float* out, int width) const {
        if (size() != kChannels) fail(fmt::format("{} channels, expected {}", json_.size(), kChannels));
        for (int c = 0; c < kChannels; ++c) at(std::size_t(c)).numbers(out + c * width, std::size_t(width));
    }

  private:
    const Json& json_;
    std::string where_;
};

Json parse(const std::filesystem::path& path) {
    const std::string text = read_input(path);
    try {
        return parse_json(text);
    } catch (const Json::exception& e) {
        throw DataError(fmt::format("{}: not valid JSON (perhaps truncated): {}", path.string(), e.what()));
    }
}

}  // namespace

void write_ppisp_json(const std::filesystem::path& path, const PpispFile& file) {
    const PpispState& state = file.state;
    AtomicFile target(path);
    std::ostream& out = target.stream();
    out << fmt::format(
        "{{\n\"version\": {},\n\"generator\": {},\n\"iteration\": {},\n\"exif\": {},\n\"mean_exif\": "
        "{:.9g},\n\"cameras\": [",
        kVersion, json_text(Json(version_text())), file.iteration, file.exif, file.mean_exif);
    for (int c = 0; c < state.num_cameras; ++c) {
        const float* values = state.param.data() + state.camera_offset(c);
        out << (c ? ",\n" : "\n") << "{\"vignetting\": ";
        write_channels(out, values, kIspVignetting);
        out << ", \"response\": ";
        write_channels(out, values + kChannels * kIspVignetting, kIspResponse);
        if (!state.controller.empty()) {
            out << ",\n \"controller\": ";
            write_list(out, state.controller.data() + std::size_t(c) * kControllerWeights, kControllerWeights);
        }
        out << '}';
    }
    out << "\n],\n\"frames\": [";
    for (int f = 0; f < state.num_frames; ++f) {
        const PpispFile::Frame& frame = file.frames[std::size_t(f)];
        const float* values = state.param.data() + std::size_t(f) * kIspFrameValues;
        out << (f ? ",\n" : "\n")
            << fmt::format("{{\"image\": {}, \"camera\": {}, \"exposure\": {:.9g}, \"color\": ",
                           json_text(Json(frame.image)), frame.camera, values[0]);
        write_list(out, values + 1, kLatents);
        if (frame.exif_exposure) out << fmt::format(", \"exif_exposure\": {:.9g}", *frame.exif_exposure);
        out << '}';
    }
    out << "\n]\n}\n";
    target.commit();
}

PpispFile read_ppisp_json(const std::filesystem::path& path) {
    const Json json = parse(path);
    const Node top(json, path.string());
    const std::int64_t version = top.at("version").integer(0, 1 << 30);
    if (version != kVersion) top.fail(fmt::format("version is {}, but this program reads {}", version, kVersion));
    PpispFile file;
    file.iteration = top.at("iteration").integer(0, std::int64_t(1) << 40);
    file.exif = top.at("exif").flag();
    file.mean_exif = top.at("mean_exif").number();
    const Node cameras = top.at("cameras"), frames = top.at("frames");
    if (cameras.size() == 0) cameras.fail("at least one camera is needed");
    file.state = identity_ppisp(int(frames.size()), int(cameras.size()));
    const bool controllers = cameras.at(std::size_t(0)).has("controller");
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const Node camera = cameras.at(c);
        float* values = file.state.param.data() + file.state.camera_offset(int(c));
        camera.at("vignetting").channels(values, kIspVignetting);
        camera.at("response").channels(values + kChannels * kIspVignetting, kIspResponse);
        if (camera.has("controller") != controllers) camera.fail("either all cameras have a controller or none");
        if (!controllers) continue;
        // The memory grows camera by camera, so that a long list of empty cameras does not allocate all their weights.
        file.state.controller.resize((c + 1) * std::size_t(kControllerWeights));
        camera.at("controller").numbers(&file.state.controller[c * kControllerWeights], kControllerWeights);
    }
    for (std::size_t f = 0; f < frames.size(); ++f) {
        const Node frame = frames.at(f);
        float* values = file.state.param.data() + f * kIspFrameValues;
        values[0] = frame.at("exposure").number();
        frame.at("color").numbers(values + 1, kLatents);
        file.frames.push_back(
            {frame.at("image").text(), int(frame.at("camera").integer(0, std::int64_t(cameras.size()) - 1))});
        if (frame.has("exif_exposure")) file.frames.back().exif_exposure = frame.at("exif_exposure").number();
    }
    return file;
}

}  // namespace gs
