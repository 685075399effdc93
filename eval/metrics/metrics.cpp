// SPDX-License-Identifier: Apache-2.0
// Lists the metrics, creates them by name, and compares two images with them.
#include "eval/metrics/metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "eval/metrics/quantize.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/train/choose_backend.h"

namespace gs {
namespace {

const MetricInfo& metric_info(const std::string& name) {
    const auto& all = known_metrics();
    const auto found = std::find_if(all.begin(), all.end(), [&](const MetricInfo& info) { return info.name == name; });
    if (found != all.end()) return *found;
    std::string names;
    for (const MetricInfo& info : all) names += (names.empty() ? "" : ", ") + info.name;
    throw UsageError(fmt::format("--metrics: '{}' is not one of {}, all", name, names));
}

MetricScore measured(double value) { return {value, ""}; }

/// Returns Metric::compute for a metric with weights. The net is shared because functions are copied.
template <class Net> auto checked_size(std::shared_ptr<const Net> net, int min_side) {
    return [net, min_side](const Image& render, const Image& truth) {
        require_same_size(render, truth);
        if (std::min(render.width, render.height) < min_side)
            return MetricScore{std::nullopt,
                               fmt::format("not measured: images of {}x{} pixels, the net needs {} in each direction",
                                           render.width, render.height, min_side)};
        return measured((*net)(render, truth));
    };
}

std::optional<MetricScore> without_weights(const std::filesystem::path& folder, const std::vector<std::string>& files) {
    if (folder.empty())
        return MetricScore{std::nullopt, "not measured: no weights (see scripts/export_metric_weights.py)"};
    for (const std::string& file : files) {
        if (!path_exists(folder / file))
            return MetricScore{
                std::nullopt,
                fmt::format("not measured: no weights: {} is missing (see scripts/export_metric_weights.py)",
                            (folder / file).string())};
    }
    return std::nullopt;
}

/// Engine and net shared by learned metrics. Each is created for the first metric that needs it.
class SharedNets {
  public:
    explicit SharedNets(const MetricOptions& options) : options_(options) {}

    std::shared_ptr<const TensorEngine> engine() {
        if (!engine_) engine_ = choose_tensor_engine(options_.device);
        return engine_;
    }
    std::shared_ptr<const FeatureNet> vgg16() {
        if (!vgg16_) vgg16_ = load_vgg16(engine(), options_.weights / "vgg16.safetensors");
        return vgg16_;
    }

  private:
    const MetricOptions& options_;
    std::shared_ptr<const TensorEngine> engine_;
    std::shared_ptr<const FeatureNet> vgg16_;
};

Metric make_metric(const std::string& name, const MetricOptions& options, SharedNets& nets) {
    Metric metric{metric_info(name), "", nullptr};
    // Missing weights are a valid result. Damaged weights are an error now rather than after rendering.
    const auto learned = [&](const std::vector<std::string>& files, const auto& load) {
        if (const auto missing = without_weights(options.weights, files)) {
            metric.compute = [score = *missing](const Image&, const Image&) { return score; };
        } else {
            metric.compute = load();
        }
    };
    if (name == "psnr") {
        metric.protocol = "10 log10(1/MSE) over all pixels and channels";
        metric.compute = [](const Image& a, const Image& b) { return measured(psnr(a, b)); };
    } else if (name == "ssim") {
        metric.protocol = describe_ssim(options.ssim_border);
        metric.compute = [border = options.ssim_border](const Image& a, const Image& b) {
            return measured(ssim(a, b, border));
        };
    } else if (name == "flip") {
        metric.protocol = describe_flip(options.flip_pixels_per_degree);
        metric.compute = [ppd = options.flip_pixels_per_degree](const Image& a, const Image& b) {
            return measured(flip(a, b, ppd));
        };
    } else if (name == "dists") {
        metric.protocol = Dists::describe();
        learned(Dists::files(), [&] {
            return checked_size(std::make_shared<const Dists>(nets.vgg16(), options.weights), Dists::kMinSide);
        });
    } else if (name == "milo") {
        metric.protocol = Milo::describe();
        learned(Milo::files(), [&] {
            return checked_size(std::make_shared<const Milo>(nets.engine(), options.weights), Milo::kMinSide);
        });
    } else {
        const LpipsNet kind = name == "lpips-vgg" ? LpipsNet::kVgg : LpipsNet::kAlex;
        metric.protocol = Lpips::describe(kind, options.lpips_range);
        learned(Lpips::files(kind), [&] {
            const auto net = kind == LpipsNet::kVgg
                                 ? nets.vgg16()
                                 : load_alexnet(nets.engine(), options.weights / "alexnet.safetensors");
            const auto lpips = std::make_shared<const Lpips>(net, kind, options.weights, options.lpips_range);
            return checked_size(lpips, lpips->min_side());
        });
    }
    return metric;
}

}  // namespace

const std::vector<MetricInfo>& known_metrics() {
    static const std::vector<MetricInfo> all = {
        {"psnr", "PSNR", true, 2},
        {"ssim", "SSIM", true, 4},
        {"lpips-vgg", "LPIPS-VGG", false, 4},
        {"lpips-alex", "LPIPS-Alex", false, 4},
        {"flip", "FLIP", false, 4},
        {"dists", "DISTS", false, 4},
        {"milo", "MILO", false, 4},
    };
    return all;
}

std::vector<Metric> make_metrics(const std::vector<std::string>& names, const MetricOptions& options) {
    SharedNets nets(options);
    std::vector<Metric> metrics;
    for (const std::string& name : names) metrics.push_back(make_metric(name, options, nets));
    return metrics;
}

std::vector<std::string> parse_metric_names(const std::string& list) {
    std::vector<std::string> wanted;
    for (std::size_t begin = 0; begin <= list.size();) {
        const std::size_t end = std::min(list.find(',', begin), list.size());
        const std::string name = list.substr(begin, end - begin);
        if (name != "all") metric_info(name);
        wanted.push_back(name);
        begin = end + 1;
    }
    const auto is_wanted = [&](const std::string& name) {
        return std::find(wanted.begin(), wanted.end(), name) != wanted.end();
    };
    std::vector<std::string> names;
    for (const MetricInfo& info : known_metrics()) {
        if (is_wanted("all") || is_wanted(info.name)) names.push_back(info.name);
    }
    return names;
}

std::filesystem::path metric_weights_folder(const std::string& given) {
    const char* variable = std::getenv("GSAPP_METRIC_WEIGHTS");
    const std::string folder = !given.empty() ? given : variable != nullptr ? variable : "";
    if (!folder.empty() && !folder_exists(folder))
        throw UsageError(
            fmt::format("{}: '{}' is no folder", given.empty() ? "GSAPP_METRIC_WEIGHTS" : "--metric-weights", folder));
    return folder;
}

using Json = nlohmann::ordered_json;

std::vector<ImageScore> compare_images(const std::filesystem::path& render, const std::filesystem::path& truth,
                                       const std::vector<std::string>& metrics, const MetricOptions& options) {
    const Image a = quantized_target(read_image(render), {0, 0, 0}), b = quantized_target(read_image(truth), {0, 0, 0});
    if (a.width != b.width || a.height != b.height)
        throw UsageError(fmt::format("images to compare must be of one size: {} is {}x{}, {} is {}x{}", render.string(),
                                     a.width, a.height, truth.string(), b.width, b.height));
    std::vector<ImageScore> scores;
    for (const Metric& metric : make_metrics(metrics, options))
        scores.push_back({metric.info, metric.protocol, metric.compute(a, b)});
    return scores;
}

std::string format_scores(const std::vector<ImageScore>& scores) {
    std::string text;
    for (const auto& [metric, protocol, score] : scores)
        text += score.value ? fmt::format("{:<10} {:>9.{}f}  {} is better; {}\n", metric.key, *score.value,
                                          metric.decimals, metric.higher_is_better ? "higher" : "lower", protocol)
                            : fmt::format("{:<10} {}\n", metric.key, score.reason);
    return text;
}

Json scores_json(const std::vector<ImageScore>& scores) {
    Json json = {{"scores", Json::object()}, {"not_measured", Json::object()}};
    for (const auto& [metric, protocol, score] : scores) {
        if (score.value)
            json["scores"][metric.key] = std::isfinite(*score.value) ? Json(*score.value) : Json(nullptr);
        else
            json["not_measured"][metric.key] = score.reason;
        json["protocol"][metric.name] = protocol;
    }
    return json;
}

}  // namespace gs
