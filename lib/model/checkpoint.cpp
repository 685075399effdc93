// SPDX-License-Identifier: Apache-2.0
// Checkpoint fields as safetensors tensors and metadata.
#include "lib/model/checkpoint.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
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
                             int width) {
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
    write_safetensors(path, tensors,
                      {{"format", kFormat},
                       {"generator", version_text()},
                       {"iteration", std::to_string(checkpoint.iteration)},
                       {"seed", std::to_string(checkpoint.seed)},
                       {"adam_step", std::to_string(g.step)},
                       {"active_degree", std::to_string(g.active_degree)},
                       {"appearance", g.appearance.model},
                       {"max_degree", std::to_string(g.appearance.max_degree)},
                       {"color_activation", color_activation_name(g.appearance.activation)},
                       {"options", checkpoint.options_yaml}});
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
    return c;
}

}  // namespace gs
