// SPDX-License-Identifier: Apache-2.0
// The CPU backend of one appearance model: the rasterizer, the loss, and a fused backward + Adam + noise per Gaussian.
#pragma once

#include "appearance/model_info.h"
#include "kernels/ceilings.h"
#include "kernels/cpu_rasterizer.h"
#include "kernels/densify/densify.h"
#include "kernels/loss/loss.h"
#include "kernels/optimizer/update_device.h"

namespace gs {

template <class Model> class CpuBackend final : public Backend {
  public:
    explicit CpuBackend(const BackendOptions&) {} // every sum has a fixed order here; images stay where they are

    std::string describe() const override { return "CPU, " + std::to_string(num_threads()) + " threads"; }

    void upload(const Gaussians& state) override {
        state_ = state;
        for (auto& group : state_.groups) {
            group.m.resize(group.param.size(), 0.0f);
            group.v.resize(group.param.size(), 0.0f);
        }
        state_.shared.m.resize(state_.shared.param.size(), 0.0f);
        state_.shared.v.resize(state_.shared.param.size(), 0.0f);
    }
    Gaussians download(bool with_moments) override {
        if (with_moments) return state_;
        Gaussians out;
        out.count = state_.count, out.appearance = state_.appearance, out.active_degree = state_.active_degree, out.step = state_.step;
        for (int g = 0; g < kNumGroups; ++g) out.groups[g].width = state_.groups[g].width, out.groups[g].param = state_.groups[g].param;
        out.shared.width = state_.shared.width, out.shared.param = state_.shared.param;
        out.ppisp = state_.ppisp;
        return out;
    }
    std::int64_t count() const override { return state_.count; }
    void set_active_degree(int degree) override { state_.active_degree = degree; }
    void upload_ppisp(const PpispState& state) override { state_.ppisp = state; }

    void render(const RenderRequest& request, RenderedImage& out) override {
        const std::size_t pixels = std::size_t(request.camera.width) * request.camera.height;
        out.width = request.camera.width, out.height = request.camera.height;
        out.rgb.resize(3 * pixels);
        out.alpha.resize(pixels);
        raster_.forward(ParameterView<float>::of(state_), request.camera, request.background, state_.active_degree, request.mode, out.rgb.data(),
                        out.alpha.data());
        for (float& t : out.alpha) t = 1 - t;
    }

    void step(const StepRequest& r) override {
        const std::size_t pixels = std::size_t(r.camera.width) * r.camera.height;
        image_.resize(3 * pixels);
        transmittance_.resize(pixels);
        dL_dimage_.resize(3 * pixels);
        const auto params = ParameterView<float>::of(state_);
        raster_.forward(params, r.camera, r.background, state_.active_degree, RenderMode::kFull, image_.data(), transmittance_.data());
        const LossValues loss = timed_loss(r);
        stats_.loss = loss.loss, stats_.l1 = loss.l1, stats_.ssim = loss.ssim;
        stats_.num_instances = raster_.num_instances();
        ++stats_.steps;
        ++state_.step; // counts steps that are then skipped, too: a device learns about those too late to count otherwise
        if (!std::isfinite(loss.loss)) {
            ++stats_.consecutive_skips;
            return;
        }
        stats_.consecutive_skips = 0;
        raster_.backward(image_.data(), transmittance_.data(), dL_dimage_.data());
        update(r, params);
        count_work(pixels);
    }

    void distill(const StepRequest&) override { throw UsageError("this backend does not train controllers yet"); }

    StepStats take_stats() override {
        const StepStats out = stats_;
        stats_.steps = 0;
        stats_.num_nonfinite_gradients = 0;
        return out;
    }

    void synchronize() override {}

    double time_frames(const std::vector<RenderRequest>& views, int repeats) override {
        RenderedImage image;
        double seconds = 0;
        for (int round = 0; round <= repeats; ++round) {
            if (round == 1) seconds = 0;
            const StageTimer timer(seconds);
            for (const RenderRequest& view : views) render(view, image);
        }
        return seconds / (double(repeats) * double(views.size()));
    }

    void measure_stages(bool) override {} // reading the clock costs nothing here

    std::vector<StageCost> take_stage_costs() override {
        auto& s = raster_.seconds;
        const double gaussians = work_.gaussians, pairs = work_.pairs;
        const ModelInfo& info = appearance_model(state_.appearance.model);
        const bool residual = state_.active_degree > 0;
        const double values = 14.0 + (residual ? state_[Group::kResidual].width : 0); // parameters of a Gaussian that are used
        const double operations = residual ? info.operations : 0, operations_backward = residual ? info.operations_backward : 0;
        // Instructions are counted in the templates: fragment_alpha 17 (of these 10 for exp2) + blend_fragment 10;
        // backward fragment_alpha 17 + blend_fragment_backward 34. A splat is 40 bytes, its sums 36.
        std::vector<StageCost> costs = {
            {"preprocess", s.preprocess, gaussians, "Gaussian", gaussians * (4 * values + 12) + work_.visible * (40 + 8) + work_.instances * 4,
             work_.visible * (260 + operations),
             "one Gaussian at a time in scalar code, the floor assumes full vectors; exponentials, a logarithm, the loop over tiles", true},
            {"sort", s.sort, work_.instances, "instance", work_.visible * 4 * 16 + work_.instances * (4 + 4 + 8), work_.instances * 4,
             "a comparison sort of 8-byte keys, the floor assumes streaming"},
            {"blend", s.blend, pairs, "pixel x Gaussian", work_.instances * (8 + 40 + 2) + work_.pixels * 16, pairs * 27, ""},
            {"loss", loss_seconds_, work_.pixels, "pixel", work_.pixels * 3 * 4 * 16, work_.pixels * 3 * (110 + 68 + 40 + 70),
             "each image row is read eleven times from the cache"},
            {"blend backward", s.blend_backward, pairs, "pixel x Gaussian", work_.instances * (8 + 40 + 2 + 36) + work_.pixels * 28, pairs * 51, ""},
            {"Gaussian backward + Adam", update_seconds_, gaussians, "Gaussian", gaussians * 24 * values + work_.instances * 36,
             work_.visible * (500 + operations_backward) + gaussians * 10 * values,
             "one Gaussian at a time in scalar code, the floor assumes full vectors", true}};
        s = {};
        loss_seconds_ = update_seconds_ = 0;
        work_ = {};
        return costs;
    }

    Ceilings measure_ceilings() override { return cpu_ceilings(); }

    MemoryUse memory() override { return {}; } // the process's memory is the operating system's to tell

    DensifyStats densify_mcmc(const McmcParams& params, std::int64_t iteration, std::uint64_t seed) override {
        return mcmc_densify(state_, params, iteration, seed);
    }
    DensifyStats densify_adc(const AdcParams& params, std::int64_t iteration, std::uint64_t seed) override {
        return adc_densify(state_, params, iteration, seed);
    }
    void reset_opacity() override { adc_reset_opacity(state_); }
    std::vector<float> scores(const std::vector<RenderRequest>& views) override {
        std::vector<double> sums(state_.count, 0.0);
        for (const RenderRequest& view : views) {
            const std::size_t pixels = std::size_t(view.camera.width) * view.camera.height;
            image_.resize(3 * pixels);
            transmittance_.resize(pixels);
            raster_.forward(ParameterView<float>::of(state_), view.camera, view.background, state_.active_degree, RenderMode::kFull, image_.data(),
                            transmittance_.data());
            raster_.add_scores(image_.data(), transmittance_.data(), sums);
        }
        return {sums.begin(), sums.end()};
    }
    std::int64_t prune_lowest_scores(const std::vector<RenderRequest>& views, double ratio) override {
        return remove_lowest_scores(state_, scores(views), ratio);
    }
    void morton_sort() override { gather_rows(state_, morton_order(state_)); }

    std::int64_t prune_nonfinite(std::int64_t by_group[kNumGroups]) override { return remove_nonfinite(state_, by_group); }
    std::int64_t prune_invisible() override { return remove_invisible(state_); }

  private:
    LossValues timed_loss(const StepRequest& r) {
        const StageTimer timer(loss_seconds_);
        return loss_.compute(image_.data(), r.target, r.background, r.lambda_dssim, dL_dimage_.data());
    }

    void count_work(std::size_t pixels) {
        work_.gaussians += double(state_.count);
        work_.visible += double(raster_.num_visible());
        work_.instances += double(raster_.num_instances());
        work_.pixels += double(pixels);
        work_.pairs += double(kLanes) * double(raster_.num_lane_operations());
    }

    void update(const StepRequest& r, const ParameterView<float>& params) {
        const StageTimer timer(update_seconds_);
        const UpdateArgs args = update_args(r, state_.step, state_.count);
        const int width = state_[Group::kResidual].width;
        if (r.gather_gradient_stats) {
            state_.gradient_sum.resize(state_.count, 0.0f);
            state_.gradient_count.resize(state_.count, 0.0f);
        }
        ModelArrays arrays{};
        for (int g = 0; g < kNumGroups; ++g) {
            auto& group = state_.groups[g];
            arrays.param[g] = group.param.data(), arrays.m[g] = group.m.data(), arrays.v[g] = group.v.data(), arrays.width[g] = group.width;
        }
        if (r.gather_gradient_stats) arrays.gradient_sum = state_.gradient_sum.data(), arrays.gradient_count = state_.gradient_count.data();
        const std::int64_t parts = num_parts(state_.count);
        nonfinite_.assign(parts, 0);
        dL_dshared_.assign(parts * kNumSharedOf<Model>, 0.0f);
        parallel_for(parts, [&](std::int64_t part) {
            typename CpuRasterizer<float, Model>::FullGradient gradient;
            for (std::int64_t i = part * kPartSize, end = std::min(state_.count, i + kPartSize); i < end; ++i) {
                raster_.gaussian_gradient(params, i, gradient, dL_dshared_.data() + part * kNumSharedOf<Model>);
                if (!drop_nonfinite(gradient, gradient.residual, width)) ++nonfinite_[part];
                update_gaussian(arrays, args, i, gradient);
                update_residual(arrays, args, i, gradient.residual);
            }
        });
        for (std::int64_t n : nonfinite_) stats_.num_nonfinite_gradients += n;
        for (int k = 0; k < kNumSharedOf<Model>; ++k) {
            double sum = 0;
            for (std::int64_t part = 0; part < parts; ++part) sum += dL_dshared_[part * kNumSharedOf<Model> + k];
            auto& shared = state_.shared;
            if (!update_shared(shared.param[k], shared.m[k], shared.v[k], float(sum), args.shared_step)) ++stats_.num_nonfinite_gradients;
        }
    }

    /// One step of the residual of Gaussian i.
    static void update_residual(const ModelArrays& a, const UpdateArgs& u, std::int64_t i, const float* dL_dresidual) {
        const int k = int(Group::kResidual), width = a.width[k];
        float *p = a.param[k] + i * width, *m = a.m[k] + i * width, *v = a.v[k] + i * width;
        if (u.per_column) {
            for (int c = 0; c < width; ++c) adam_update(p[c], m[c], v[c], dL_dresidual[c], u.residual_steps[c]);
            return;
        }
        const AdamStep<float> t = u.steps[k];
#pragma omp simd
        for (int c = 0; c < width; ++c) adam_update(p[c], m[c], v[c], dL_dresidual[c], t);
    }

    Gaussians state_;
    CpuRasterizer<float, Model> raster_;
    ImageLoss<float> loss_;
    std::vector<float> image_, transmittance_, dL_dimage_;
    std::vector<float> dL_dshared_; ///< a row for each part, so that the sum has a fixed order
    std::vector<std::int64_t> nonfinite_;
    StepStats stats_;
    double loss_seconds_ = 0, update_seconds_ = 0;
    struct {
        double gaussians = 0, visible = 0, instances = 0, pixels = 0, pairs = 0;
    } work_; ///< of the steps since the last take_stage_costs
};

}  // namespace gs
