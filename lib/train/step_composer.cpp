// SPDX-License-Identifier: Apache-2.0
// Composes view, rates, regularisers and correction of one training step.
#include "lib/train/step_composer.h"

#include <cmath>

#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

/// The power of the number of views by which the rates of a step on several grow. Were the gradients of views
/// independent it would be 1/2, were they the same 1 (docs/math/ranks.md#batch has the tries).
constexpr double kBatchRate = 0.6;

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
    const std::int64_t id = std::int64_t(view.index) + view.level * std::int64_t(scene_.train.size());
    if (view.image) {
        const Image& color = view.image->color;
        request.camera = camera_params(resized(camera, color.width, color.height));
        request.target = target_image(*view.image, id);
        request.pixels = view.image;
    } else {
        request.camera = camera_params(view.level > 0 ? reduced(camera, view.level + 1) : camera);
        request.target.id = id;
    }
    request.background = view.background;
    request.iteration = iteration;
    request.lambda_dssim = float(options_.lambda_dssim);
    request.seed = seed_;
    return request;
}

StepRequest StepComposer::compose(const StepView& view, const Moment& moment, const Moment& rate_moment) const {
    StepRequest request = request_of(view, moment.iteration);
    const bool mcmc = strategy_ == Strategy::kMcmc;
    request.opacity_reg = mcmc ? float(options_.opacity_reg) : 0.0f;
    request.scale_reg = mcmc ? float(options_.scale_reg) : 0.0f;
    request.gather_gradient_stats = strategy_ == Strategy::kAdc && !window_.until.reached(moment);
    request.only_visible = options_.adam == Movers::kVisible;
    rates_.apply(rate_moment, request);
    if (photometric_) {
        photometric_->apply(view.index, moment, request);
    } else {
        request.isp = {.mode = IspMode::kFrame, .frame = int(view.index), .camera = scene_.train[view.index].camera_id};
        request.isp_rate = ppisp_rate_;
    }
    if (rate_factor_ != 1) {
        for (double& rate : request.rates) rate *= rate_factor_;
        for (double& rate : request.residual_rates) rate *= rate_factor_;
        request.shared_rate *= rate_factor_;
        request.noise *= float(rate_factor_);
        request.isp_rate *= rate_factor_;
    }
    return request;
}

void StepComposer::combine(std::vector<StepRequest>& requests) {
    StepRequest& first = requests.front();
    const double factor = std::pow(double(requests.size()), kBatchRate);
    for (double& rate : first.rates) rate *= factor;
    for (double& rate : first.residual_rates) rate *= factor;
    first.shared_rate *= factor;
    first.noise *= float(factor);
    first.isp_rate *= factor;
    for (StepRequest& other : requests) other.isp_rate = first.isp_rate;
}

StepRequest StepComposer::compose_distillation(const StepView& view, std::int64_t iteration) const {
    StepRequest request = request_of(view, iteration);
    photometric_->apply_controller(view.index, request);
    return request;
}

}  // namespace gs
