// SPDX-License-Identifier: Apache-2.0
// Checkpoint fields as safetensors tensors and metadata.
#include "lib/model/checkpoint.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/core/error.h"
#include "kernels/core/portable.h"
#include "lib/core/version.h"
#include "lib/io/safetensors.h"
#include "lib/model/appearance_spec.h"

namespace gs {
namespace {

constexpr const char* kFormat = "gsapp-checkpoint-1";
/// Weights that all Gaussians of the model share.
constexpr const char* kSharedName = "shared_weights";

template <class Int>
Int metadata_number(const SafetensorsFile& file, const std::string& name, const std::string& key) {
    const std::string& text = file.metadata(key);
    Int value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || std::cmp_less(value, 0)) {
        throw DataError(fmt::format("cannot read '{}': metadata '{}' is '{}', not a count", name, key, text));
    }
    return value;
}

/// Reads one (count, width) tensor and checks its shape before and its values after.
std::vector<float> read_rows(const SafetensorsFile& file, const std::string& name, const std::string& tensor, std::int64_t count,
                             std::int64_t width) {
    const auto& shape = file.tensor(tensor).shape;
    if (shape.size() != 2 || shape[0] != count || shape[1] != width) {
        throw DataError(fmt::format("cannot read '{}': tensor '{}' does not have the shape ({}, {})", name, tensor, count, width));
    }
    std::vector<float> values = file.read<float>(tensor);
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (!gs_isfinite(values[i])) {
            throw DataError(fmt::format("cannot read '{}': tensor '{}' holds {} in row {}; use an earlier checkpoint", name, tensor,
                                        values[i], i / std::size_t(width)));
        }
    }
    return values;
}

PpispState read_ppisp(const SafetensorsFile& file, const std::string& name) {
    PpispState isp;
    const auto has = [&](const std::string& tensor) { return file.tensors().contains(tensor); };
    if (!has("ppisp")) return isp;
    isp.num_frames = metadata_number<int>(file, name, "ppisp_frames");
    isp.num_cameras = metadata_number<int>(file, name, "ppisp_cameras");
    isp.step = metadata_number<std::int64_t>(file, name, "ppisp_step");
    isp.controller_step = metadata_number<std::int64_t>(file, name, "ppisp_controller_step");
    // Before the sizes are computed: neither may overflow them.
    constexpr int kMost = 1 << 24;
    if (isp.num_cameras < 1 || isp.num_cameras > kMost || isp.num_frames > kMost) throw DataError(fmt::format("cannot read '{}': PPISP of {} frames and {} cameras", name, isp.num_frames, isp.num_cameras));
    const auto read = [&](const std::string& tensor, std::int64_t size) { return has(tensor) ? read_rows(file, name, tensor, 1, size) : std::vector<float>(); };
    const auto size = std::int64_t(isp.size()), weights = std::int64_t(isp.num_cameras) * kControllerWeights;
    isp.param = read("ppisp", size), isp.m = read("adam_m.ppisp", size), isp.v = read("adam_v.ppisp", size);
    isp.controller = read("ppisp_controller", weights);
    isp.controller_m = read("adam_m.ppisp_controller", weights), isp.controller_v = read("adam_v.ppisp_controller", weights);
    return isp;
}

}  // namespace

void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint) {
    const Gaussians& g = checkpoint.state;
    std::vector<TensorView> tensors;
    const auto add = [&](const std::string& name, const GroupArrays<float>& group, const std::vector<float>& values) {
        tensors.push_back({name, Dtype::kF32, {g.count, group.width}, values.data()});
    };
    const bool with_moments = !g[Group::kMean].m.empty();
    for (int i = 0; i < kNumGroups; ++i) add(kGroupNames[i], g.groups[i], g.groups[i].param);
    for (int i = 0; with_moments && i < kNumGroups; ++i) {
        add(std::string("adam_m.") + kGroupNames[i], g.groups[i], g.groups[i].m);
        add(std::string("adam_v.") + kGroupNames[i], g.groups[i], g.groups[i].v);
    }
    if (g.shared.width > 0) {
        const auto add_shared = [&](const std::string& name, const std::vector<float>& values) { tensors.push_back({name, Dtype::kF32, {1, g.shared.width}, values.data()}); };
        add_shared(kSharedName, g.shared.param);
        if (with_moments) add_shared(std::string("adam_m.") + kSharedName, g.shared.m), add_shared(std::string("adam_v.") + kSharedName, g.shared.v);
    }
    if (!g.gradient_sum.empty()) {
        tensors.push_back({"gradient_sum", Dtype::kF32, {g.count, 1}, g.gradient_sum.data()});
        tensors.push_back({"gradient_count", Dtype::kF32, {g.count, 1}, g.gradient_count.data()});
    }
    const PpispState& isp = g.ppisp;
    const auto add_isp = [&](const std::string& name, const std::vector<float>& values) {
        if (!values.empty()) tensors.push_back({name, Dtype::kF32, {1, std::int64_t(values.size())}, values.data()});
    };
    if (isp.active()) {
        add_isp("ppisp", isp.param), add_isp("adam_m.ppisp", isp.m), add_isp("adam_v.ppisp", isp.v);
        add_isp("ppisp_controller", isp.controller), add_isp("adam_m.ppisp_controller", isp.controller_m), add_isp("adam_v.ppisp_controller", isp.controller_v);
    }
    std::map<std::string, std::string> metadata =
                      {{"format", kFormat},
                       {"generator", version_text()},
                       {"iteration", std::to_string(checkpoint.iteration)},
                       {"seed", std::to_string(checkpoint.seed)},
                       {"adam_step", std::to_string(g.step)},
                       {"active_degree", std::to_string(g.active_degree)},
                       {"appearance", g.appearance.model},
                       {"max_degree", std::to_string(g.appearance.max_degree)},
                       {"color_activation", color_activation_name(g.appearance.activation)},
                       {"options", checkpoint.options_yaml}};
    if (isp.active()) {
        metadata["ppisp_frames"] = std::to_string(isp.num_frames), metadata["ppisp_cameras"] = std::to_string(isp.num_cameras);
        metadata["ppisp_step"] = std::to_string(isp.step), metadata["ppisp_controller_step"] = std::to_string(isp.controller_step);
    }
    write_safetensors(path, tensors, metadata);
}

Checkpoint read_checkpoint(const std::filesystem::path& path) {
    const SafetensorsFile file(path);
    const std::string name = path.string();
    if (file.metadata("format") != kFormat) {
        throw DataError(fmt::format("cannot read '{}': format '{}', expected '{}'", name, file.metadata("format"), kFormat));
    }
    Checkpoint c;
    c.iteration = metadata_number<std::int64_t>(file, name, "iteration");
    c.seed = metadata_number<std::uint64_t>(file, name, "seed");
    c.options_yaml = file.metadata("options");
    Gaussians& g = c.state;
    g.step = metadata_number<std::int64_t>(file, name, "adam_step");
    g.active_degree = metadata_number<int>(file, name, "active_degree");
    g.appearance = appearance_from_file(name, file.metadata("appearance"), metadata_number<int>(file, name, "max_degree"),
                                        file.metadata("color_activation"));
    if (g.active_degree > g.appearance.max_degree) {
        throw DataError(
            fmt::format("cannot read '{}': active_degree {} is above max_degree {}", name, g.active_degree, g.appearance.max_degree));
    }
    const auto& means = file.tensor(kGroupNames[0]).shape;
    g.count = means.empty() ? 0 : means[0];
    if (g.count == 0) throw DataError(fmt::format("cannot read '{}': it holds no Gaussians", name));
    const bool with_moments = file.tensors().contains(std::string("adam_m.") + kGroupNames[0]);
    for (int i = 0; i < kNumGroups; ++i) {
        GroupArrays<float>& group = g.groups[i];
        group.width = group_width(Group(i), g.appearance);
        group.param = read_rows(file, name, kGroupNames[i], g.count, group.width);
        if (!with_moments) continue;
        group.m = read_rows(file, name, std::string("adam_m.") + kGroupNames[i], g.count, group.width);
        group.v = read_rows(file, name, std::string("adam_v.") + kGroupNames[i], g.count, group.width);
    }
    g.shared.width = appearance_model(g.appearance.model).num_shared;
    if (g.shared.width > 0) {
        g.shared.param = read_rows(file, name, kSharedName, 1, g.shared.width);
        for (const float w : g.shared.param) {
            if (std::abs(w) > float(kLargestSharedWeight)) throw DataError(fmt::format("cannot read '{}': tensor '{}' holds {}; weights stay within +-{}", name, kSharedName, w, kLargestSharedWeight));
        }
        if (with_moments) {
            g.shared.m = read_rows(file, name, std::string("adam_m.") + kSharedName, 1, g.shared.width);
            g.shared.v = read_rows(file, name, std::string("adam_v.") + kSharedName, 1, g.shared.width);
        }
    }
    if (file.tensors().contains("gradient_sum")) {
        g.gradient_sum = read_rows(file, name, "gradient_sum", g.count, 1);
        g.gradient_count = read_rows(file, name, "gradient_count", g.count, 1);
    }
    g.ppisp = read_ppisp(file, name);
    return c;
}

}  // namespace gs
