// SPDX-License-Identifier: Apache-2.0
// Encodes depths and normals as colours that are blended without loss, and decodes the result.
#include "apps/gsapp/render/geometry_renderer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "kernels/base/parallel.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {
namespace {

/// Largest depth in the red channel, frame units. The activation max(0, y + 1/2), limited to 255, can show any colour
/// from 0 to 255. Above 1/8 its rounding is that of a float, so two channels cover all depths between the near plane at
/// 0.2 and the far plane at 10000 frame units: red for depths up to kFar, green for larger depths divided by kFar.
constexpr double kFar = 128;

float base_of(double color) { return std::isfinite(color) ? float(color - 0.5) : -0.5f; }

/// Returns the geometry of the model with a single base colour per Gaussian.
Gaussians geometry_of(const Gaussians& model) {
    Gaussians out;
    out.count = model.count, out.antialiased = model.antialiased;
    out.appearance = {"none", 0, ColorActivation::kRelu};
    for (const Group g : {Group::kMean, Group::kScale, Group::kRotation, Group::kOpacity}) {
        out[g].width = model[g].width;
        out[g].param = model[g].param;
    }
    out[Group::kBase] = {3, std::vector<float>(3 * std::size_t(model.count)), {}, {}};
    return out;
}

Eigen::Vector3d mean_of(const Gaussians& model, std::int64_t i) {
    return Eigen::Map<const Eigen::Vector3f>(&model[Group::kMean].param[3 * std::size_t(i)]).cast<double>();
}

/// Returns the unit vector along the shortest axis; among equally short axes, the first one.
Eigen::Vector3d shortest_axis(const Gaussians& model, std::int64_t i) {
    const float* scale = &model[Group::kScale].param[3 * std::size_t(i)];
    const float* q = &model[Group::kRotation].param[4 * std::size_t(i)];
    const auto axis = std::min_element(scale, scale + 3) - scale;
    return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix().col(axis);
}

}  // namespace

GeometryRenderer::GeometryRenderer(const SavedRun& run)
    : scale_(run.scene.frame.scale),
      model_(geometry_of(run.backend->download(false))),
      backend_(make_backend(run.options.device, model_.appearance, engine_options(run.options))) {}

RenderedImage GeometryRenderer::render(const Camera& camera, bool median) {
    backend_->upload(model_);
    RenderRequest request;
    request.camera = camera_params(camera);
    request.median = median;
    RenderedImage image;
    backend_->render(request, image);
    return image;
}

std::vector<float> GeometryRenderer::depth(const Camera& camera, DepthKind kind) {
    parallel_for_rows(model_.count, [&](std::int64_t i) {
        const Eigen::Vector3d p = camera.rotation * mean_of(model_, i) + camera.translation;
        const double z = is_pinhole(camera) ? p.z() : p.norm();
        float* base = &model_[Group::kBase].param[3 * std::size_t(i)];
        base[0] = base_of(z <= kFar ? z : 0), base[1] = base_of(z <= kFar ? 0 : z / kFar), base[2] = base_of(1);
    });
    const RenderedImage image = render(camera, kind == DepthKind::kMedian);
    const std::size_t pixels = image.alpha.size();
    const float* near = image.rgb.data();
    const float *far = near + pixels, *weight = far + pixels;  // a median has weight 1
    std::vector<float> depth(pixels);
    for (std::size_t i = 0; i < pixels; ++i)
        if (weight[i] > 0) depth[i] = float((near[i] + kFar * far[i]) / (weight[i] * scale_));
    return depth;
}

std::vector<float> GeometryRenderer::normals(const Camera& camera) {
    const Eigen::Vector3d center = camera.center();
    parallel_for_rows(model_.count, [&](std::int64_t i) {
        Eigen::Vector3d normal = shortest_axis(model_, i);
        if (normal.dot(center - mean_of(model_, i)) < 0) normal = -normal;
        // Colours cannot be negative: -1..1 is mapped to 0..1, and the sum of weights undoes the shift.
        for (int c = 0; c < 3; ++c)
            model_[Group::kBase].param[3 * std::size_t(i) + std::size_t(c)] = base_of(0.5 + 0.5 * normal[c]);
    });
    RenderedImage image = render(camera);
    const std::size_t pixels = image.alpha.size();
    for (std::size_t i = 0; i < pixels; ++i) {
        Eigen::Vector3d sum;
        for (std::size_t c = 0; c < 3; ++c) sum[int(c)] = 2.0 * image.rgb[c * pixels + i] - image.alpha[i];
        // Below 1e-5 only rounding errors remain.
        const Eigen::Vector3d normal = sum.norm() > 1e-5 ? Eigen::Vector3d(sum.normalized()) : Eigen::Vector3d::Zero();
        for (std::size_t c = 0; c < 3; ++c) image.rgb[c * pixels + i] = float(normal[int(c)]);
    }
    image.alpha = std::vector<float>();  // frees memory for the copy: an image may have 2^25 pixels
    std::vector<float> normals(3 * pixels);
    for (std::size_t c = 0; c < 3; ++c)
        for (std::size_t i = 0; i < pixels; ++i) normals[3 * i + c] = image.rgb[c * pixels + i];
    return normals;
}

}  // namespace gs
