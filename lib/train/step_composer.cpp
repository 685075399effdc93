// SPDX-License-Identifier: Apache-2.0
// Composes the view, rates, regularisers and correction of one training step.
#include "lib/train/step_composer.h"

#include <cmath>

#include "kernels/base/rng.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

/// The exponent by which rates grow with the number of views of a step. For independent gradients of the views it would
/// be 1/2, for identical gradients 1 (experiments: docs/math/ranks.md#batch).
constexpr double kBatchRate = 0.6;

/// Returns whether a step through a lens draws as pinhole cameras do. A random quarter of the steps does, so that the
/// model looks right through pinholes, too (docs/math/rasterizer.md#lenses).
bool draws_as_pinholes(std::uint64_t seed, std::int64_t iteration) {
    return philox(seed, RngStream::kAsPinholes, std::uint64_t(iteration), 0).v[0] % 4 == 0;
}

}  // namespace

StepComposer::StepComposer(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene,
                           const Photometric* photometric, double rate_factor)
    : options_(options),
      strategy_(options.strategy),
      ppisp_rate_(options.ppisp_lr),
      seed_(options.seed),
      scene_(scene),
      photometric_(photometric),
      rates_(options, appearance, scene),
      window_(options),
      rate_factor_(rate_factor) {}

StepRequest StepComposer::request_of(const StepView& view, std::int64_t iteration) const {
    StepRequest request;
    const Camera& camera = scene_.train[view.index].camera;
    const ImageId id{int(view.index), view.factor};
    if (view.image) {
        const Image& color = view.image->color;
        request.camera = camera_params(resized(camera, color.width, color.height));
        request.target = target_image(*view.image, id);
        request.pixels = view.image;
    } else {
        request.camera = camera_params(view.factor > 1 ? reduced(camera, view.factor) : camera);
        request.target.id = id;
    }
    request.camera.lens.as_pinholes = draws_as_pinholes(seed_, iteration);
    request.background = view.background;
    request.iteration = iteration;
    request.loss.lambda_dssim = float(options_.lambda_dssim);
    request.seed = seed_;
    return request;
}

StepRequest StepComposer::compose(const StepView& view, const ScheduleMoment& moment,
                                  const ScheduleMoment& rate_moment) const {
    StepRequest request = request_of(view, moment.iteration);
    const bool mcmc = strategy_ == Strategy::kMcmc;
    request.loss.opacity_reg = mcmc ? float(options_.opacity_reg) : 0.0f;
    request.loss.scale_reg = mcmc ? float(options_.scale_reg) : 0.0f;
    request.gather_gradient_stats = strategy_ == Strategy::kAdc && !window_.until.reached(moment);
    request.only_visible = options_.adam == Movers::kVisible;
    request.rates = rates_.at(rate_moment);
    if (photometric_) {
        photometric_->apply(view.index, moment, request);
    } else {
        request.isp = {.mode = IspMode::kFrame, .frame = int(view.index), .camera = scene_.train[view.index].camera_id};
        request.rates.isp = ppisp_rate_;
    }
    if (rate_factor_ != 1) request.rates.scale(rate_factor_);
    return request;
}

void StepComposer::combine(std::vector<StepRequest>& requests) {
    StepRequest& first = requests.front();
    first.rates.scale(std::pow(double(requests.size()), kBatchRate));
    for (StepRequest& other : requests) other.rates.isp = first.rates.isp;
}

StepRequest StepComposer::compose_distillation(const StepView& view, std::int64_t iteration) const {
    StepRequest request = request_of(view, iteration);
    photometric_->apply_controller(view.index, request);
    return request;
}

}  // namespace gs
