// SPDX-License-Identifier: Apache-2.0
// Renders views of an open run to files.
#include "apps/gsapp/render/render_views.h"

#include <fmt/format.h>

#include "apps/gsapp/render/false_colors.h"
#include "apps/gsapp/render/frame_folder.h"
#include "apps/gsapp/render/geometry_renderer.h"
#include "eval/metrics/quantize.h"
#include "eval/runs/decompose.h"
#include "eval/runs/render_queue.h"
#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/camera_params.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

std::string frame_name(std::size_t i, const char* extension) { return fmt::format("{:05}.{}", i, extension); }

/// Writes values as <folder>/0000i.exr, and returns them as an image.
Image write_values(const fs::path& folder, std::size_t i, const Camera& camera, std::vector<float> values) {
    Image image;
    image.width = camera.width, image.height = camera.height;
    image.channels = int(values.size() / (std::size_t(camera.width) * std::size_t(camera.height)));
    image.f32 = std::move(values);
    write_image(folder / frame_name(i, "exr"), image);
    return image;
}

/// Returns directions as colours: -1..1 is mapped to 0..1, and a zero vector to black.
Image colored_normals(Image image) {
    for (std::size_t i = 0; i < image.f32.size(); i += 3) {
        float* n = &image.f32[i];
        if (n[0] == 0 && n[1] == 0 && n[2] == 0) continue;
        for (int c = 0; c < 3; ++c) n[c] = 0.5f + 0.5f * n[c];
    }
    return image;
}

/// Returns one channel as 8-bit grey.
Image grey(const Image& image) {
    Image out{image.width, image.height, 3, std::vector<std::uint8_t>(3 * image.f32.size()), {}};
    for (std::size_t i = 0; i < out.u8.size(); ++i) out.u8[i] = to_8_bits(image.f32[i / 3]);
    return out;
}

/// The depths of one kind, and their range so far.
struct Depths {
    DepthKind kind;
    DepthRangeFinder range = {};
};

std::vector<Depths> wanted_depths(const RenderParts& parts) {
    std::vector<Depths> wanted;
    if (parts.depth) wanted.push_back({DepthKind::kExpected});
    if (parts.median_depth) wanted.push_back({DepthKind::kMedian});
    return wanted;
}

/// Writes images of the saved depths, whose common range is known only after all views.
void write_depth_pictures(const fs::path& folder, std::size_t count, const Depths& depths) {
    const fs::path part = folder / depth_folder(depths.kind);
    const DepthRange range = depths.range.range();
    for (std::size_t i = 0; i < count; ++i) {
        Image read = read_image(part / frame_name(i, "exr"));
        std::vector<float> depth(std::size_t(read.width) * std::size_t(read.height));
        for (std::size_t p = 0; p < depth.size(); ++p) depth[p] = read.f32[p * std::size_t(read.channels)];
        read.f32 = std::vector<float>();
        write_image(part / frame_name(i, "png"), colored_depth(depth, read.width, read.height, range));
    }
    write_text_atomic(folder / depth_range_file(depths.kind), depth_range_text(range, depths.kind));
}

}  // namespace

std::vector<View> views_of(const std::vector<Camera>& cameras) {
    std::vector<View> views(cameras.size());
    for (std::size_t i = 0; i < cameras.size(); ++i) views[i].camera = cameras[i];
    return views;
}

const std::vector<View>& views_of(const Scene& scene, const std::string& which) {
    return which == "test" ? scene.test : scene.train;
}

fs::path picture_folder(const fs::path& folder, const RenderParts& parts) {
    return parts.decompose ? folder / kPictureParts[0].name : folder;
}

std::vector<std::string> render_files(const RenderParts& parts, std::size_t num_views) {
    std::vector<std::string> files;
    const auto add = [&](const fs::path& part, const char* extension) {
        for (std::size_t i = 0; i < num_views; ++i) files.push_back((part / frame_name(i, extension)).string());
    };
    add(picture_folder("", parts), "png");
    if (parts.decompose) add(kPictureParts[1].name, "png"), add(kPictureParts[2].name, "png");
    const auto add_values = [&](const char* part) { add(part, "exr"), add(part, "png"); };
    for (const Depths& depths : wanted_depths(parts)) {
        add_values(depth_folder(depths.kind));
        files.push_back(depth_range_file(depths.kind).string());
    }
    if (parts.normals) add_values("normals");
    if (parts.alpha) add_values("alpha");
    return files;
}

void render_views(SavedRun& run, const std::vector<View>& views, const EvalCorrection& correction,
                  const RenderParts& parts, const fs::path& folder) {
    std::unique_ptr<GeometryRenderer> geometry;
    std::vector<Depths> wanted = wanted_depths(parts);
    if (!wanted.empty() || parts.normals) geometry = std::make_unique<GeometryRenderer>(run);
    std::vector<RenderRequest> requests;
    for (const View& view : views)
        for (const auto& [mode, name] : kPictureParts)
            if (parts.decompose || mode == RenderMode::kFull)
                requests.push_back(
                    part_request(camera_params(view.camera), run.background, mode, view_isp(view, correction)));
    RenderQueue renders(*run.backend, std::move(requests));
    RenderedImage image;
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (interrupted()) throw Interrupted(fmt::format("stopped after {} of {} pictures", i, views.size()));
        const Camera& camera = views[i].camera;
        for (const auto& [mode, name] : kPictureParts) {
            if (!parts.decompose && mode != RenderMode::kFull) continue;
            image = RenderedImage{};  // frees its memory before the next image is rendered
            image = renders.next();
            write_image(folder / (parts.decompose ? name : "") / frame_name(i, "png"), quantized_render(image));
        }
        // An image of 2^25 pixels takes 512 MiB, so each is freed before the next quantity is rendered.
        image.rgb = std::vector<float>();
        for (Depths& depths : wanted) {
            std::vector<float> depth = geometry->depth(camera, depths.kind);
            depths.range.add(depth, image.alpha);
            write_values(folder / depth_folder(depths.kind), i, camera, std::move(depth));
        }
        if (parts.alpha) {
            const Image values = write_values(folder / "alpha", i, camera, std::move(image.alpha));
            write_image(folder / "alpha" / frame_name(i, "png"), grey(values));
        }
        image = RenderedImage{};
        if (parts.normals) {
            Image values = write_values(folder / "normals", i, camera, geometry->normals(camera));
            write_image(folder / "normals" / frame_name(i, "png"), colored_normals(std::move(values)));
        }
    }
    for (const Depths& depths : wanted) write_depth_pictures(folder, views.size(), depths);
}

}  // namespace gs
