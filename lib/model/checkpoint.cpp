// SPDX-License-Identifier: Apache-2.0
// Stores a checkpoint's fields as safetensors tensors and metadata.
#include "lib/model/checkpoint.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/base/portable.h"
#include "lib/core/choices.h"
#include "lib/core/version.h"
#include "lib/io/safetensors.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

constexpr const char* kFormat = "gsapp-checkpoint-1";
/// The name of the tensor with the weights shared by all Gaussians of the model.
constexpr const char* kSharedName = "shared_weights";
constexpr const char *kPpispName = "ppisp", *kControllerName = "controller";

template <class Int> Int metadata_number(const SafetensorsFile& file, const std::string& name, const std::string& key) {
    const std::string& text = file.metadata(key);
    Int value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || std::cmp_less(value, 0)) {
        throw DataError(fmt::format("cannot read '{}': metadata '{}' is '{}', not a count", name, key, text));
    }
    return value;
}

double metadata_seconds(const SafetensorsFile& file, const std::string& name, const std::string& key) {
    const std::string& text = file.metadata(key);
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value) || value < 0)
        throw DataError(fmt::format("cannot read '{}': metadata '{}' is '{}', not a time in seconds", name, key, text));
    return value;
}

/// Reads one tensor of shape (count, width). Checks its shape before and its values after reading.
std::vector<float> read_rows(const SafetensorsFile& file, const std::string& name, const std::string& tensor,
                             std::int64_t count, std::int64_t width) {
    const auto& shape = file.tensor(tensor).shape;
    if (shape.size() != 2 || shape[0] != count || shape[1] != width) {
        throw DataError(
            fmt::format("cannot read '{}': tensor '{}' does not have the shape ({}, {})", name, tensor, count, width));
    }
    std::vector<float> values = file.read<float>(tensor);
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (!gs_isfinite(values[i])) {
            throw DataError(fmt::format("cannot read '{}': tensor '{}' holds {} in row {}; use an earlier checkpoint",
                                        name, tensor, values[i], i / std::size_t(width)));
        }
    }
    return values;
}

/// Reads the variances of the 3-D filter.
GroupArrays<float> read_smoothing(const SafetensorsFile& file, const std::string& name, std::int64_t count) {
    const std::string tensor = kGroupNames[int(Group::kSmoothing)];
    if (!file.tensors().contains(tensor)) return {};
    GroupArrays<float> smoothing{1, read_rows(file, name, tensor, count, 1), {}, {}};
    for (std::size_t i = 0; i < smoothing.param.size(); ++i)
        if (smoothing.param[i] < 0)
            throw DataError(fmt::format("cannot read '{}': tensor '{}' holds {} in row {}, expected a variance", name,
                                        tensor, smoothing.param[i], i));
    return smoothing;
}

/// Adds one row of parameters, with its moments if there are any.
void add_row(std::vector<TensorView>& tensors, const std::string& name, const std::vector<float>& param,
             const std::vector<float>& m, const std::vector<float>& v) {
    const auto add = [&](const std::string& tensor, const std::vector<float>& values) {
        if (!values.empty()) tensors.push_back({tensor, Dtype::kF32, {1, std::int64_t(values.size())}, values.data()});
    };
    add(name, param), add("adam_m." + name, m), add("adam_v." + name, v);
}

void read_row(const SafetensorsFile& file, const std::string& path, const std::string& name, std::size_t size,
              std::vector<float>& param, std::vector<float>& m, std::vector<float>& v) {
    param = read_rows(file, path, name, 1, std::int64_t(size));
    if (!file.tensors().contains("adam_m." + name)) return;
    m = read_rows(file, path, "adam_m." + name, 1, std::int64_t(size));
    v = read_rows(file, path, "adam_v." + name, 1, std::int64_t(size));
}

void add_ppisp(const PpispState& p, std::vector<TensorView>& tensors, std::map<std::string, std::string>& metadata) {
    if (!p.active()) return;
    metadata["ppisp_frames"] = std::to_string(p.num_frames);
    metadata["ppisp_cameras"] = std::to_string(p.num_cameras);
    metadata["ppisp_step"] = std::to_string(p.step);
    metadata["controller_step"] = std::to_string(p.controller_step);
    add_row(tensors, kPpispName, p.param, p.m, p.v);
    add_row(tensors, kControllerName, p.controller, p.controller_m, p.controller_v);
}

PpispState read_ppisp(const SafetensorsFile& file, const std::string& name) {
    PpispState p;
    if (!file.tensors().contains(kPpispName)) return p;
    p.num_frames = metadata_number<int>(file, name, "ppisp_frames");
    p.num_cameras = metadata_number<int>(file, name, "ppisp_cameras");
    p.step = metadata_number<std::int64_t>(file, name, "ppisp_step");
    p.controller_step = metadata_number<std::int64_t>(file, name, "controller_step");
    if (!p.active()) throw DataError(fmt::format("cannot read '{}': its '{}' has no cameras", name, kPpispName));
    read_row(file, name, kPpispName, p.size(), p.param, p.m, p.v);
    if (file.tensors().contains(kControllerName))
        read_row(file, name, kControllerName, std::size_t(p.num_cameras) * kControllerWeights, p.controller,
                 p.controller_m, p.controller_v);
    return p;
}

/// Adds rows of equal length, which are joined in `joined`.
void add_doubles(const char* name, const std::vector<std::vector<double>>& rows, std::vector<double>& joined,
                 std::vector<TensorView>& tensors) {
    if (rows.empty()) return;
    for (const auto& row : rows) joined.insert(joined.end(), row.begin(), row.end());
    tensors.push_back({name, Dtype::kF64, {std::int64_t(rows.size()), std::int64_t(rows[0].size())}, joined.data()});
}

/// Reads rows of `width` finite values.
std::vector<std::vector<double>> read_doubles(const SafetensorsFile& file, const std::string& name,
                                              const std::string& tensor, std::size_t width) {
    const auto& shape = file.tensor(tensor).shape;
    if (shape.size() != 2 || shape[0] < 1 || shape[1] != std::int64_t(width))
        throw DataError(
            fmt::format("cannot read '{}': tensor '{}' does not have the shape (n, {})", name, tensor, width));
    const std::vector<double> values = file.read<double>(tensor);
    std::vector<std::vector<double>> rows;
    for (std::size_t k = 0; k < values.size(); ++k) {
        if (!std::isfinite(values[k]))
            throw DataError(fmt::format("cannot read '{}': tensor '{}' holds {} in row {}; use an earlier checkpoint",
                                        name, tensor, values[k], k / width));
        if (k % width == 0) rows.emplace_back();
        rows.back().push_back(values[k]);
    }
    return rows;
}

CameraState read_cameras(const SafetensorsFile& file, const std::string& name) {
    if (!file.tensors().contains("camera_views")) return {};
    return {read_doubles(file, name, "camera_views", CameraState::kViewValues),
            read_doubles(file, name, "camera_lenses", CameraState::kLensValues),
            metadata_number<std::int64_t>(file, name, "camera_gradients")};
}

Frame frame_of(const SafetensorsFile& file, const std::string& name) {
    if (!file.metadata().contains("frame")) return {};
    const auto frame = parse_frame(file.metadata("frame"));
    if (!frame)
        throw DataError(fmt::format("cannot read '{}': metadata 'frame' is '{}', not 'center X Y Z scale S'", name,
                                    file.metadata("frame")));
    return *frame;
}

}  // namespace

Frame read_checkpoint_frame(const std::filesystem::path& path) {
    return frame_of(SafetensorsFile(path), path.string());
}

std::int64_t read_checkpoint_iteration(const std::filesystem::path& path) {
    return metadata_number<std::int64_t>(SafetensorsFile(path), path.string(), "iteration");
}

void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint) {
    const Gaussians& g = checkpoint.state;
    std::vector<TensorView> tensors;
    const auto add = [&](const std::string& name, int group, const std::vector<float>& values) {
        if (Group(group) == Group::kSmoothing && values.empty()) return;
        tensors.push_back({name, Dtype::kF32, {g.num_rows(Group(group)), g.groups[group].width}, values.data()});
    };
    const bool with_moments = !g[Group::kMean].m.empty();
    for (int i = 0; i < kNumGroups; ++i) add(kGroupNames[i], i, g.groups[i].param);
    for (int i = 0; with_moments && i < int(Group::kSmoothing); ++i) {
        add(std::string("adam_m.") + kGroupNames[i], i, g.groups[i].m);
        add(std::string("adam_v.") + kGroupNames[i], i, g.groups[i].v);
    }
    if (g.shared.width > 0) {
        const auto add_shared = [&](const std::string& name, const std::vector<float>& values) {
            tensors.push_back({name, Dtype::kF32, {1, g.shared.width}, values.data()});
        };
        add_shared(kSharedName, g.shared.param);
        if (with_moments)
            add_shared(std::string("adam_m.") + kSharedName, g.shared.m),
                add_shared(std::string("adam_v.") + kSharedName, g.shared.v);
    }
    if (!g.gradient_sum.empty()) {
        tensors.push_back({"gradient_sum", Dtype::kF32, {g.count, 1}, g.gradient_sum.data()});
        tensors.push_back({"gradient_count", Dtype::kF32, {g.count, 1}, g.gradient_count.data()});
    }
    if (!g.last_step.empty()) tensors.push_back({"last_step", Dtype::kF32, {g.count, 1}, g.last_step.data()});
    std::map<std::string, std::string> metadata = {{"format", kFormat},
                                                   {"generator", version_text()},
                                                   {"iteration", std::to_string(checkpoint.iteration)},
                                                   {"seed", std::to_string(checkpoint.seed)},
                                                   {"adam_step", std::to_string(g.step)},
                                                   {"active_degree", std::to_string(g.active_degree)},
                                                   {"appearance", g.appearance.model},
                                                   {"max_degree", std::to_string(g.appearance.max_degree)},
                                                   {"color_activation", word(g.appearance.activation)},
                                                   {"options", checkpoint.options_yaml},
                                                   {"frame", frame_text(checkpoint.frame)}};
    if (checkpoint.time) {
        metadata["train_seconds"] = fmt::format("{}", checkpoint.time->train_seconds);
        metadata["data_wait_seconds"] = fmt::format("{}", checkpoint.time->data_wait_seconds);
        if (checkpoint.time->limited_seconds > 0)
            metadata["limited_seconds"] = fmt::format("{}", checkpoint.time->limited_seconds);
    }
    if (!checkpoint.test_views.empty()) metadata["test_views"] = checkpoint.test_views;
    if (g.antialiased) metadata["antialiased"] = "true";
    if (checkpoint.automatic) metadata["automatic"] = "true";
    add_ppisp(g.ppisp, tensors, metadata);
    std::vector<double> views, lenses;  // must live until they are written
    add_doubles("camera_views", checkpoint.cameras.views, views, tensors);
    add_doubles("camera_lenses", checkpoint.cameras.lenses, lenses, tensors);
    if (!views.empty()) metadata["camera_gradients"] = std::to_string(checkpoint.cameras.gathered);
    write_safetensors(path, tensors, metadata);
}

Checkpoint read_checkpoint(const std::filesystem::path& path) {
    const SafetensorsFile file(path);
    const std::string name = path.string();
    if (file.metadata("format") != kFormat) {
        throw DataError(
            fmt::format("cannot read '{}': format '{}', expected '{}'", name, file.metadata("format"), kFormat));
    }
    Checkpoint c;
    c.iteration = metadata_number<std::int64_t>(file, name, "iteration");
    c.seed = metadata_number<std::uint64_t>(file, name, "seed");
    c.options_yaml = file.metadata("options");
    c.frame = frame_of(file, name);
    if (file.metadata().contains("test_views")) c.test_views = file.metadata("test_views");
    if (file.metadata().contains("train_seconds"))
        c.time = {metadata_seconds(file, name, "train_seconds"), metadata_seconds(file, name, "data_wait_seconds"),
                  file.metadata().contains("limited_seconds") ? metadata_seconds(file, name, "limited_seconds") : 0};
    c.automatic = file.metadata().contains("automatic");
    Gaussians& g = c.state;
    g.step = metadata_number<std::int64_t>(file, name, "adam_step");
    g.active_degree = metadata_number<int>(file, name, "active_degree");
    g.appearance =
        appearance_from_file(name, file.metadata("appearance"), metadata_number<int>(file, name, "max_degree"),
                             file.metadata("color_activation"));
    if (g.active_degree > g.appearance.max_degree) {
        throw DataError(fmt::format("cannot read '{}': active_degree {} is above max_degree {}", name, g.active_degree,
                                    g.appearance.max_degree));
    }
    const auto& means = file.tensor(kGroupNames[0]).shape;
    g.count = means.empty() ? 0 : means[0];
    if (g.count == 0) throw DataError(fmt::format("cannot read '{}': it holds no Gaussians", name));
    const bool with_moments = file.tensors().contains(std::string("adam_m.") + kGroupNames[0]);
    g.antialiased = file.metadata().contains("antialiased");
    g[Group::kSmoothing] = read_smoothing(file, name, g.count);
    for (int i = 0; i < int(Group::kSmoothing); ++i) {
        GroupArrays<float>& group = g.groups[i];
        group.width = group_width(Group(i), g.appearance);
        std::int64_t rows = g.count;
        if (Group(i) == Group::kResidual) {  // residuals may exist only for the first Gaussians
            const auto& shape = file.tensor(kGroupNames[i]).shape;
            if (!shape.empty() && shape[0] >= 0 && shape[0] < rows) rows = shape[0];
        }
        group.param = read_rows(file, name, kGroupNames[i], rows, group.width);
        if (!with_moments) continue;
        group.m = read_rows(file, name, std::string("adam_m.") + kGroupNames[i], rows, group.width);
        group.v = read_rows(file, name, std::string("adam_v.") + kGroupNames[i], rows, group.width);
    }
    g.shared.width = appearance_model(g.appearance.model).num_shared;
    if (g.shared.width > 0) {
        g.shared.param = read_rows(file, name, kSharedName, 1, g.shared.width);
        for (const float w : g.shared.param) {
            if (std::abs(w) > float(kLargestSharedWeight))
                throw DataError(fmt::format("cannot read '{}': tensor '{}' holds {}; weights must be within +-{}", name,
                                            kSharedName, w, kLargestSharedWeight));
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
    if (file.tensors().contains("last_step")) {
        g.last_step = read_rows(file, name, "last_step", g.count, 1);
        for (const float step : g.last_step) {
            if (step < 0 || step > float(g.step))
                throw DataError(
                    fmt::format("cannot read '{}': tensor 'last_step' holds {}, expected 0..{}", name, step, g.step));
        }
    }
    g.ppisp = read_ppisp(file, name);
    c.cameras = read_cameras(file, name);
    return c;
}

bool is_automatic_checkpoint(const std::filesystem::path& path) {
    try {
        return SafetensorsFile(path).metadata().contains("automatic");
    } catch (const DataError&) {
        return false;
    }
}

}  // namespace gs
