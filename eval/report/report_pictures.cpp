// SPDX-License-Identifier: Apache-2.0
// Embeds images of the run folders as data URIs.
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>

#include "eval/pages/escape.h"
#include "eval/pages/scatter.h"
#include "eval/report/report.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/io/image.h"
#include "lib/model/cameras_json.h"
#include "lib/model/run_folder.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kJpegQuality = 90;  ///< artefacts far below those of the models
constexpr int kErrorGain = 4;     ///< factor on errors, which are a few per cent for a trained model; shown on the page

std::string base64(const std::vector<std::uint8_t>& bytes) {
    static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    text.reserve((bytes.size() + 2) / 3 * 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        std::uint32_t group = 0;
        for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (i + k < bytes.size() ? bytes[i + k] : 0);
        for (std::size_t k = 0; k < 4; ++k) text += i + k <= bytes.size() ? kDigits[group >> (18 - 6 * k) & 63] : '=';
    }
    return text;
}

/// Returns |a - b|, multiplied by the error gain.
Image error_of(const Image& a, const Image& b) {
    Image error = a;
    for (std::size_t i = 0; i < error.u8.size(); ++i)
        error.u8[i] = std::uint8_t(std::min(255, kErrorGain * std::abs(int(a.u8[i]) - int(b.u8[i]))));
    return error;
}

/// Returns a data URI of the image, which is downsized if it is wider than `max_width`.
std::string jpeg_uri(const Image& image, int max_width) {
    const bool wide = image.width > max_width;
    return "data:image/jpeg;base64," +
           base64(encode_jpeg(
               wide ? resize_image(image, max_width, std::max(1, image.height * max_width / image.width)) : image,
               kJpegQuality));
}

/// Data URIs, each stored once because runs of one scene share their photographs.
class Images {
  public:
    explicit Images(int max_width) : max_width_(max_width) {}

    int add(const Image& image) {
        const auto [at, added] = index_.try_emplace(jpeg_uri(image, max_width_), int(uris_.size()));
        if (added) uris_.push_back(at->first);
        return at->second;
    }
    const std::vector<std::string>& uris() const { return uris_; }

  private:
    const int max_width_;
    std::map<std::string, int> index_;
    std::vector<std::string> uris_;
};

/// Returns file index and name of up to `max_views` test views of which the run has images.
std::vector<std::pair<int, std::string>> views_of(const RunResult& run, int max_views) {
    std::vector<std::pair<int, std::string>> all, chosen;
    if (!path_exists(RunFolder{run.folder}.per_view())) return {};
    const Json json = try_parse_ordered_json(read_input(RunFolder{run.folder}.per_view()));
    const std::string key = fmt::format("ours_{}", run.iteration);
    if (json.is_object() && json.contains("image_names") && json.at("image_names").contains(key))
        for (const auto& [picture, name] : json.at("image_names").at(key).items())
            all.emplace_back(int(all.size()), name.is_string() ? name.get<std::string>() : picture);
    const auto missing = [&](const auto& view) {
        return !path_exists(RunFolder{run.folder}.render("test", run.iteration, view.first));
    };
    all.erase(std::remove_if(all.begin(), all.end(), missing), all.end());
    const std::size_t count = std::min<std::size_t>(std::size_t(max_views), all.size());
    for (std::size_t i = 0; i < count; ++i) chosen.push_back(all[i * all.size() / count]);
    return chosen;
}

Json layers_of(const RunResult& run, const std::vector<std::pair<int, std::string>>& views, Images& images) {
    const RunFolder folder{run.folder};
    Json layers = {{"full", Json::array()},
                   {"base", Json::array()},
                   {"residual", Json::array()},
                   {"reference", Json::array()},
                   {"error", Json::array()}};
    for (const auto& [index, name] : views) {
        const Image full = read_image(folder.render("test", run.iteration, index)),
                    truth = read_image(folder.ground_truth("test", run.iteration, index));
        layers["full"].push_back(images.add(full));
        layers["reference"].push_back(images.add(truth));
        layers["error"].push_back(full.u8.size() == truth.u8.size() ? images.add(error_of(full, truth)) : -1);
        for (const char* part : {"base", "residual"}) {
            const auto path = folder.picture_part("test", run.iteration, part, index);
            layers[part].push_back(path_exists(path) ? images.add(read_image(path)) : -1);
        }
    }
    return layers;
}

/// Returns plot and pictures of a run's learned cameras; empty if it has none.
std::string corrections_html(const RunResult& run, int max_width) {
    const RunFolder folder{run.folder};
    const std::vector<ListedView> views = read_cameras_json(folder.cameras()), largest = corrected_views(views);
    if (largest.empty()) return {};
    ScatterPlot plot{.title = fmt::format("{}: corrections of the training images", run.run),
                     .x_title = "image, by name",
                     .y_title = "correction, pixels",
                     .points = {}};
    for (const ListedView& view : views)
        if (view.correction)
            plot.points.push_back({.x = double(plot.points.size()),
                                   .y = *view.correction,
                                   .tooltip = fmt::format("{}: {:.2f} pixels", view.name, *view.correction)});
    std::string html = scatter_svg(plot);
    for (std::size_t rank = 0; rank < largest.size() && path_exists(folder.correction(rank)); ++rank) {
        const std::string name =
            html_escaped(fmt::format("{}, {:.2f} pixels", largest[rank].name, *largest[rank].correction));
        html += fmt::format("<figure><img src=\"{}\" alt=\"{}\"><figcaption>{}</figcaption></figure>\n",
                            jpeg_uri(read_image(folder.correction(rank)), max_width), name, name);
    }
    return html;
}

}  // namespace

std::string report_cameras(const Comparison& comparison, const ReportOptions& options) {
    std::string html;
    for (const RunResult* run : runs_of(comparison)) html += corrections_html(*run, options.max_width);
    if (html.empty()) return html;
    return "<section id=\"cameras\" aria-labelledby=\"h-cameras\">\n<h2 id=\"h-cameras\">Learned cameras</h2>\n"
           "<p class=\"note\">How far the cameras of the training images moved, as the root mean square over points of "
           "the scene. Pictures, of the largest corrections: photograph and render, above with the camera of the "
           "dataset, below with the learned one.</p>\n<div class=\"plots\">\n" +
           html + "</div>\n</section>\n";
}

std::string report_pictures(const Comparison& comparison, const ReportOptions& options) {
    Images images(options.max_width);
    Json scenes = Json::array();
    for (const ComparisonTable& table : comparison.tables) {
        if (table.scene.empty() && !table.dataset.empty()) continue;
        Json runs = Json::array(), names = Json::array();
        for (const ComparisonLine& line : table.lines) {
            const auto views = views_of(line.runs[0], options.max_views);
            Json own = Json::array();
            for (const auto& view : views) own.push_back(view.second);
            if (names.empty()) names = own;
            if (own.empty() || own != names) continue;  // other views than the first run's are not comparable
            runs.push_back({{"label", line.runs[0].run + (line.model.empty() ? "" : ", " + line.model)},
                            {"layers", layers_of(line.runs[0], views, images)}});
        }
        if (!runs.empty()) scenes.push_back({{"name", table.scene}, {"views", names}, {"runs", runs}});
    }
    const Json json = {{"gain", kErrorGain}, {"scenes", scenes}, {"images", images.uris()}};
    std::string text = json_text(json);
    // A name containing "</script>" would end the element.
    for (std::size_t at = text.find('<'); at != std::string::npos; at = text.find('<', at))
        text.replace(at, 1, "\\u003c");
    return text;
}

}  // namespace gs
