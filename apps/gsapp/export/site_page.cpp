// SPDX-License-Identifier: Apache-2.0
// Finds the first view of a page and writes its head.
#include "apps/gsapp/export/site_page.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <regex>

#include "eval/pages/escape.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

using Eigen::Vector3d;

/// Largest roll of a photograph that is shown upright (the viewer's MOST_ROLL), as a tangent.
constexpr double kMostRoll = 0.176;

/// Returns the camera without its roll; for a camera on its side, width and height are swapped.
Camera upright(Camera camera, const Vector3d& up) {
    const double x = up.dot(camera.rotation.row(0)), y = -up.dot(camera.rotation.row(1));
    if (std::hypot(x, y) < 0.3 || (y > 0 && std::abs(x) <= kMostRoll * y)) return camera;
    const Vector3d center = camera.center(), forward = camera.rotation.row(2);
    if (std::abs(x) > std::abs(y)) {
        std::swap(camera.width, camera.height);
        std::swap(camera.fx, camera.fy);
    }
    camera.cx = 0.5 * camera.width, camera.cy = 0.5 * camera.height;
    camera.rotation.row(0) = forward.cross(up).normalized();
    camera.rotation.row(1) = forward.cross(Vector3d(camera.rotation.row(0)));
    camera.translation = -camera.rotation * center;
    return camera;
}

/// Returns a camera that looks from one point to another. `like` gives the aspect ratio; the vertical field of view is
/// in degrees.
Camera looking(const Vector3d& from, const Vector3d& to, double fov, const Camera& like, const Vector3d& up) {
    Camera camera = like;
    camera.cx = 0.5 * camera.width, camera.cy = 0.5 * camera.height;
    camera.fy = camera.cy / std::tan(0.5 * fov * M_PI / 180);
    camera.fx = camera.fy * like.fx / like.fy;
    const Vector3d forward = (to - from).normalized();
    Vector3d right = forward.cross(up);
    right = right.norm() > 1e-6 ? right.normalized() : forward.unitOrthogonal();
    camera.rotation.row(0) = right, camera.rotation.row(1) = forward.cross(right), camera.rotation.row(2) = forward;
    camera.translation = -camera.rotation * from;
    return camera;
}

double fov_of(const Camera& camera) { return 2 * std::atan(0.5 * camera.height / camera.fy) * 180 / M_PI; }

std::string without_extension(const std::string& name) {
    return std::filesystem::path(name).replace_extension().generic_string();
}

/// Returns the match quality of a photograph's name: 3 for the exact name, 2 without its extension, 1 without its
/// folder, 0 for no match.
int fit(const std::string& name, const std::string& wanted) {
    const std::string file = std::filesystem::path(name).filename().string();
    if (name == wanted) return 3;
    if (without_extension(name) == wanted) return 2;
    return file == wanted || without_extension(file) == wanted ? 1 : 0;
}

/// Returns the photograph with this name; null if there is none. Throws UsageError if several match.
const View* find_photograph(const std::string& wanted, const Scene& scene) {
    const View* best = nullptr;
    int best_fit = 0;
    bool ambiguous = false;
    for (const auto* views : {&scene.test, &scene.train}) {
        for (const View& view : *views) {
            const int fits = fit(view.name, wanted);
            if (fits == 0 || fits < best_fit) continue;
            ambiguous = fits == best_fit && view.name != best->name;
            best = &view, best_fit = fits;
        }
    }
    if (ambiguous)
        throw UsageError(
            fmt::format("--start-view {}: several photographs are called so, one of them '{}'; give the "
                        "whole name",
                        wanted, best->name));
    return best;
}

/// Reads `count` numbers separated by commas.
std::optional<std::vector<double>> read_numbers(const std::string& text, std::size_t count) {
    std::vector<double> values;
    const char *at = text.data(), *end = at + text.size();
    while (values.size() < count) {
        double value = 0;
        const auto [rest, error] = std::from_chars(at, end, value);
        if (error != std::errc{} || !(std::abs(value) <= 1e15)) return std::nullopt;
        values.push_back(value);
        at = rest;
        if (values.size() < count && (at == end || *at++ != ',')) return std::nullopt;
    }
    return at == end ? std::optional(values) : std::nullopt;
}

/// Returns the value of a key in a fragment.
std::optional<std::string> value_of(const std::string& fragment, const std::string& key) {
    std::size_t begin = 0;
    while (begin < fragment.size()) {
        const std::size_t end = std::min(fragment.find('&', begin), fragment.size());
        const std::string pair = fragment.substr(begin, end - begin);
        if (pair.rfind(key + "=", 0) == 0) return pair.substr(key.size() + 1);
        begin = end + 1;
    }
    return std::nullopt;
}

std::string point(const Vector3d& p) { return fmt::format("{:.6g},{:.6g},{:.6g}", p.x(), p.y(), p.z()); }

/// Returns the fragment for a camera's view, with its target at the distance of the model's centre.
std::string fragment_of(const Camera& camera, const Vector3d& center) {
    const Vector3d from = camera.center(), forward = camera.rotation.row(2);
    const double distance = std::max(forward.dot(center - from), 0.1 * (center - from).norm() + 1e-3);
    return fmt::format("from={}&to={}&fov={:.5g}", point(from), point(from + distance * forward), fov_of(camera));
}

[[noreturn]] void refuse(const std::string& text, const NamedViews& views) {
    std::string called = "there are no photographs";
    for (const auto* some : {&views.scene.train, &views.scene.test})
        if (!some->empty()) called = fmt::format("they are called like '{}'", some->front().name);
    throw UsageError(
        fmt::format("--start-view {}: no photograph of the scene is called so ({}); a number counts the "
                    "views of the page's list, of which there are {}, and a link that the page copied is a "
                    "view as well",
                    text, called, views.shown.size()));
}

/// Returns the camera of a fragment. Throws UsageError if the fragment has no view; `text` is the user's input.
Camera camera_of(const std::string& fragment, const std::string& text, const NamedViews& views, const Camera& first) {
    if (const auto number = value_of(fragment, "view")) {
        const auto value = read_numbers(*number, 1);
        if (!value || !(value->front() >= 1 && value->front() <= double(views.shown.size()))) refuse(text, views);
        return upright(views.shown[std::size_t(value->front()) - 1].camera, views.up);
    }
    const auto from = value_of(fragment, "from"), to = value_of(fragment, "to"), fov = value_of(fragment, "fov");
    if (!from && !to) return first;
    const auto a = read_numbers(from.value_or(""), 3), b = read_numbers(to.value_or(""), 3);
    const auto angle = fov ? read_numbers(*fov, 1) : std::vector<double>{fov_of(first)};
    if (!a || !b || *a == *b || !angle || !(angle->front() >= 1 && angle->front() <= 175)) refuse(text, views);
    return looking(Vector3d(a->data()), Vector3d(b->data()), angle->front(), first, views.up);
}

}  // namespace

StartView find_start_view(const std::string& text, const NamedViews& views, const View& first) {
    StartView start{"", first};
    const Camera usual = start.view.camera = upright(first.camera, views.up);
    if (text.empty()) return start;
    if (const View* photograph = find_photograph(text, views.scene)) {
        const auto shown = std::find_if(views.shown.begin(), views.shown.end(),
                                        [&](const View& view) { return view.name == photograph->name; });
        start.view = *photograph;
        start.view.camera = upright(photograph->camera, views.up);
        start.fragment = shown == views.shown.end() ? fragment_of(start.view.camera, views.center)
                                                    : fmt::format("view={}", shown - views.shown.begin() + 1);
        return start;
    }
    static const std::regex number("[0-9]{1,9}"),
        fragment("(?:.*#)?([a-z]+=[A-Za-z0-9,.+-]+(&[a-z]+=[A-Za-z0-9,.+-]+)*)");
    std::smatch parts;
    if (std::regex_match(text, number))
        start.fragment = "view=" + text;
    else if (std::regex_match(text, parts, fragment))
        start.fragment = parts[1];
    else
        refuse(text, views);
    start.view.camera = camera_of(start.fragment, text, views, usual);
    return start;
}

Camera preview_camera(const Camera& camera, int width, int height) {
    const double scale = std::max(double(width) / camera.width, double(height) / camera.height);
    Camera out = camera;
    out.width = width, out.height = height;
    out.fx = scale * camera.fx, out.fy = scale * camera.fy;
    out.cx = 0.5 * width + scale * (camera.cx - 0.5 * camera.width);
    out.cy = 0.5 * height + scale * (camera.cy - 0.5 * camera.height);
    return out;
}

std::string folder_url(const std::string& url) {
    static const std::regex known("(https?://[^\\s?#\"<>]+?)/*(/index\\.html)?/*", std::regex::icase);
    std::smatch parts;
    if (!std::regex_match(url, parts, known))
        throw UsageError(
            fmt::format("--url {}: it is the address of the page's folder, such as "
                        "https://example.org/garden",
                        url));
    return parts[1];
}

std::string with_head(const std::string& html, const PageHead& head) {
    const std::string open = "<title>", close = "</title>";
    const std::size_t begin = html.find(open), end = html.find(close);
    if (begin == std::string::npos || end == std::string::npos || end < begin)
        throw DataError("the page of the web viewer has no title; scripts/build-viewer builds it anew");
    std::string tags = open + html_escaped(head.title) + close;
    const auto add = [&](const char* kind, const char* name, const std::string& content) {
        if (!content.empty())
            tags += fmt::format("\n    <meta {}=\"{}\" content=\"{}\" />", kind, name, html_escaped(content));
    };
    const std::string base = head.url.empty() ? "" : head.url + "/";
    add("name", "description", head.description);
    add("property", "og:type", "website");
    add("property", "og:title", head.title);
    add("property", "og:description", head.description);
    add("property", "og:url", base);
    if (!head.preview.empty()) {
        add("property", "og:image", base + head.preview);
        add("property", "og:image:width", std::to_string(kPreviewWidth));
        add("property", "og:image:height", std::to_string(kPreviewHeight));
        add("property", "og:image:alt", "A picture of the scene");
        add("name", "twitter:card", "summary_large_image");
    }
    if (head.own_title) add("name", "gsapp:title", head.title);
    add("name", "gsapp:start", head.start);
    return html.substr(0, begin) + tags + html.substr(end + close.size());
}

}  // namespace gs
