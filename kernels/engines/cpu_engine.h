// SPDX-License-Identifier: Apache-2.0
// The CPU engine of one appearance model: the rasterizer, the loss, and the fused backward pass, Adam and noise per
// Gaussian.
#pragma once

#include <deque>
#include <utility>

#include "appearance/model_info.h"
#include "kernels/base/ceilings.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/residual_handles.h"
#include "kernels/engine.h"
#include "kernels/engines/cpu_rasterizer.h"
#include "kernels/loss/loss.h"
#include "kernels/optimizer/update_device.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/splat/smoothing_device.h"
#include "kernels/splat/splat_order.h"

namespace gs {

template <class Model> class CpuEngine : public Engine {
  public:
    /// Uses only the cutoffs of `options`. Every sum has a fixed order on the CPU, and images are not copied.
    explicit CpuEngine(const EngineOptions& options)
        : raster_(default_max_instances(), Cutoffs<float>::of(options.min_alpha, options.min_transmittance)) {
        traits_ = {.device = "CPU, " + std::to_string(num_threads()) + " threads", .ceilings = &cpu_ceilings};
    }

    void upload(const Gaussians& state) override {
        state_ = state;
        for (auto& group : state_.groups) {
            group.m.resize(group.param.size(), 0.0f);
            group.v.resize(group.param.size(), 0.0f);
        }
        state_.shared.m.resize(state_.shared.param.size(), 0.0f);
        state_.shared.v.resize(state_.shared.param.size(), 0.0f);
        allocate_moments(state_.ppisp);
    }
    Gaussians download(Download what) override {
        if (what == Download::kAll) return state_;
        Gaussians out;
        out.count = state_.count, out.appearance = state_.appearance, out.active_degree = state_.active_degree,
        out.step = state_.step, out.antialiased = state_.antialiased;
        if (what == Download::kPpisp) return out.ppisp = state_.ppisp, out;
        for (int g = 0; g < kNumGroups; ++g) {
            out.groups[g].width = state_.groups[g].width;
            if (what == Download::kParameters || g == int(Group::kBase)) out.groups[g].param = state_.groups[g].param;
        }
        if (what == Download::kBases) return out;
        out.shared.width = state_.shared.width, out.shared.param = state_.shared.param;
        out.ppisp = state_.ppisp;
        drop_moments(out.ppisp);
        return out;
    }
    RowCounts counts() const override { return {state_.count, state_.num_residuals()}; }
    void set_active_degree(int degree) override { state_.active_degree = degree; }
    void update_smoothing(const std::vector<CameraParams<float>>& cameras) override {
        auto& smoothing = state_[Group::kSmoothing];
        if (smoothing.width == 0) return;
        const auto params = ParameterView<float>::of(state_);
        parallel_for_rows(state_.count, [&](std::int64_t i) {
            smoothing.param[std::size_t(i)] = smoothing_variance(params.mean(i), cameras.data(), int(cameras.size()));
        });
    }
    void upload_ppisp(const PpispState& state) override {
        state_.ppisp = state;
        allocate_moments(state_.ppisp);
    }

    void render(const RenderRequest& request, const SplatParts* splats, RenderedImage& out) override {
        const std::size_t pixels = std::size_t(request.camera.width) * request.camera.height;
        out.width = request.camera.width, out.height = request.camera.height;
        out.rgb.resize(3 * pixels);
        out.alpha.resize(pixels);
        forward(request, splats, out.rgb.data(), out.alpha.data());
        for (float& t : out.alpha) t = 1 - t;
        if (request.median) raster_.write_medians(out.rgb.data());
        // A residual is not a colour, so it is not corrected.
        if (request.mode != RenderMode::kResidualOnly && is_corrected(state_.ppisp, request.isp))
            correction_.apply(state_.ppisp, request.isp, out.rgb.data(), out.width, out.height, out.rgb.data());
    }

    void step(const StepRequest& r) override {
        keep_last_steps(r);
        const bool corrected = is_corrected(state_.ppisp, r.isp), corrects = corrected && r.rates.isp > 0;
        const ViewLoss loss = view_loss(r, corrected);
        ++state_.step;  // skipped steps count too: a device detects them too late to leave them out
        if (corrects) ++state_.ppisp.step;
        if (!note_loss(loss)) return;
        backward(corrected);
        update(r, ParameterView<float>::of(state_));
        if (corrects) {
            const StageTimer timer(correction_seconds_);
            if (!correction_.step_parameters(state_.ppisp, r.rates.isp)) leave_out_common(1);
        }
        count_work(r);
    }

    void distill(const StepRequest& r, const SplatParts* splats) override {
        check_distillation(state_.ppisp, r.isp);
        const ViewLoss loss = view_loss(r, true, splats);
        if (r.rates.isp > 0) ++state_.ppisp.controller_step;
        if (!note_loss(loss) || r.rates.isp <= 0) return;
        const StageTimer timer(correction_seconds_);
        correction_.backward(image_.data(), dL_dimage_.data());
        if (!correction_.step_controller(state_.ppisp, image_.data(), r.rates.isp)) leave_out_common(1);
    }

    StepStats take_stats() override {
        const StepStats out = stats_;
        stats_.steps = 0;
        stats_.num_nonfinite_gradients = stats_.num_nonfinite_common = 0;
        return out;
    }

    std::vector<ViewCameraGradient> take_camera_gradients() override { return std::exchange(camera_gradients_, {}); }

    void synchronize() override {}

    MemoryUse memory() override { return {}; }  // the operating system reports the process's memory

    DensifyStats densify(const DensifyRequest& r) override {
        if (const auto* mcmc = std::get_if<McmcParams>(&r.rule))
            return mcmc_densify(state_, *mcmc, r.iteration, r.seed);
        if (const auto* adc = std::get_if<AdcParams>(&r.rule)) return adc_densify(state_, *adc, r.iteration, r.seed);
        if (std::holds_alternative<MortonOrder>(r.rule))
            gather_rows(state_, morton_order(state_));
        else
            adc_reset_opacity(state_);
        return {.count = state_.count};
    }
    void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) override {
        ResidualHandles residuals(state_, true);
        residuals.keep(marks, bases);
        residuals.resolve();
    }
    PruneStats prune(const PruneRequest& request) override {
        PruneStats stats;
        if (std::holds_alternative<NonFiniteRows>(request))
            stats.removed = remove_nonfinite(state_, stats.by_group.data());
        else if (const auto* but = std::get_if<AllBut>(&request))
            stats.removed = state_.count - std::int64_t(but->rows.size()), gather_rows(state_, but->rows);
        else
            stats.removed = remove_invisible(state_);
        return stats;
    }

    void begin_projection(const CameraParams<float>& camera, RenderMode mode, bool) override {
        projection_ = {camera, mode};
    }
    void end_projection(ProjectedView& out, std::optional<std::size_t> room, ViewReport* report) override {
        ProjectedView all;
        ProjectedView& found = room ? all : out;
        raster_.project(ParameterView<float>::of(state_), projection_.camera, state_.active_degree, projection_.mode,
                        found);
        if (report) *report = {.loss = {}, .num_splats = std::int64_t(found.splats.size())};
        if (!room) return;
        if (report) report->lacks_splats = all.splats.size() > *room;
        const auto fit = [&](const auto& from, auto& to, auto filler) {
            const auto values = from.values().first(std::min(from.size(), *room));
            auto* const begin = to.resize(*room);
            std::fill(std::copy(values.begin(), values.end(), begin), begin + *room, filler);
        };
        fit(all.splats, out.splats, WireSplat{});
        fit(all.rows, out.rows, kNowhere);
        out.part_ends = all.part_ends;
    }
    ScratchPlaces room_for_splats(const CameraParams<float>&, std::size_t, std::size_t, bool, bool) override {
        return {};
    }
    void order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                       DeviceArray<WireSplat>& out) override {
        order_on_host(splats, rows, of_ranks, out);
    }
    void loss_of_splats(const StepRequest& r, const SplatParts& splats, const SumParts<SplatSums<float>>& sums,
                        std::vector<float>& isp_gradient, ViewReport* report) override {
        const bool corrected = is_corrected(state_.ppisp, r.isp);
        const ViewLoss loss = view_loss(r, corrected, &splats);
        if (std::isfinite(loss.loss)) {
            backward(corrected);
            write_sums(splats, sums, [&](std::int64_t i, SplatSums<float>& out) { out = raster_.sums(i); });
            if (corrected && r.rates.isp > 0) correction_.add_gradient(state_.ppisp, isp_gradient);
        } else {
            write_sums(splats, sums, [](std::int64_t, SplatSums<float>& out) { out = {}; });
        }
        count_work(r);
        report->loss = loss;
        report->loss.num_instances = raster_.num_instances();
    }
    std::vector<ViewReport> read_reports(const std::vector<ImageId>&, int) override {
        const std::vector<ViewReport> oldest = std::move(unread_reports_.front());
        unread_reports_.pop_front();
        return oldest;
    }
    void take_back(std::int64_t num_views) override {
        state_.step -= num_views;
        unread_reports_.clear();
        decision_ = StepDecision::kTake;
    }
    double half_squared_error(const StepRequest& r, const SplatParts& splats) override {
        const bool corrected = is_corrected(state_.ppisp, r.isp);
        view_image(r, corrected, &splats);
        return loss_.half_squared_error((corrected ? corrected_ : image_).data(), r.target, r.background,
                                        dL_dimage_.data());
    }
    void scores_of_splats(const RenderRequest& r, const SplatParts& splats, const SumParts<double>& scores) override {
        const std::size_t pixels = std::size_t(r.camera.width) * r.camera.height;
        image_.resize(3 * pixels);
        transmittance_.resize(pixels);
        forward(r, &splats, image_.data(), transmittance_.data());
        std::vector<double> all(num_splats(splats), 0.0);
        raster_.add_scores(image_.data(), transmittance_.data(), all);
        write_sums(splats, scores, [&](std::int64_t i, double& out) { out = all[i]; });
    }
    void residual_sums_of_splats(const StepRequest& r, const SplatParts& splats,
                                 const SumParts<ResidualSplatSums>& sums) override {
        std::vector<Vec3<float>> gradients(num_splats(splats));
        half_squared_error(r, splats);
        backward(is_corrected(state_.ppisp, r.isp));
        parallel_for_rows(std::int64_t(gradients.size()),
                          [&](std::int64_t i) { gradients[i] = raster_.color_gradient(i); });
        loss_.mask_weights(r.target, dL_dimage_.data());
        raster_.backward(image_.data(), transmittance_.data(), dL_dimage_.data());
        write_sums(splats, sums, [&](std::int64_t i, ResidualSplatSums& out) {
            out = {raster_.color_gradient(i).x, gradients[i]};
        });
    }

    void update_rows(const DeviceArray<ViewReport>& reports, const std::vector<StepRequest>& views,
                     const std::vector<ProjectedView>& projected,
                     const std::vector<DeviceArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                     DeviceArray<float>& shared_gradient) override {
        const auto all = reports.values();
        unread_reports_.emplace_back(all.begin(), all.end());
        if (decision_ != StepDecision::kRepeat) decision_ = decide_step(all);
        keep_last_steps(views[0]);
        state_.step += std::int64_t(views.size());
        if (decision_ != StepDecision::kTake)
            return shared_gradient.assign(std::vector<float>(row_of_step(views), 0.0f));
        const auto params = ParameterView<float>::of(state_);
        const int num_views = int(views.size()), width = state_[Group::kResidual].width;
        const float mean = 1 / float(num_views);
        begin_cameras(views[0], views.size());
        const UpdateArgs args = update_args(views[0], state_.step, num_gaussians, num_views);
        update_all(views[0], args, [&](std::int64_t part, const ModelArrays& arrays) {
            std::vector<std::size_t> at(views.size()), end(views.size());  // not yet taken splats of the part's rows
            for (std::size_t v = 0; v < views.size(); ++v)
                at[v] = part > 0 ? projected[v].part_ends[part - 1] : 0, end[v] = projected[v].part_ends[part];
            return [&, part, arrays, at, end](std::int64_t i, Gradient& total, float* dL_dshared) mutable {
                total = {};
                const int used = i < params.num_residuals ? width : 0;
                bool finite = true;
                for (std::size_t v = 0; v < views.size(); ++v) {
                    if (at[v] == end[v] || projected[v].rows.data()[at[v]] != i) continue;
                    Gradient one{};
                    gaussian_backward<Model>(params, i, views[v].camera, params.degree(i, state_.active_degree),
                                             sums[v].data()[at[v]++], views[v].gather_camera_gradient,
                                             static_cast<GaussianGradient<float>&>(one), one.residual, dL_dshared);
                    if (drop_nonfinite(one, one.residual, used))
                        add_gradient_statistic(arrays, views[v].camera.width, views[v].camera.height, i, one);
                    else
                        finite = false;
                    if (views[v].gather_camera_gradient) add_to_camera(part, v, one);
                    total.add(one, mean, used);
                }
                return finite;
            };
        });
        std::vector<float> shared = sum_shared();
        for (float& gradient : shared) gradient *= mean;
        for (std::size_t v = 0; views[0].gather_camera_gradient && v < views.size(); ++v)
            sum_of_camera(v).for_each([&](int, double number) { shared.push_back(float(number)); });
        shared.resize(row_of_step(views));
        shared_gradient.assign(shared);
    }
    void update_shared_weights(const std::vector<StepRequest>& views,
                               const DeviceArray<float>& shared_gradients) override {
        if (decision_ != StepDecision::kTake) return;
        std::vector<float> shared(kNumSharedOf<Model>);
        const int row = int(row_of_step(views));
        const auto sum = [&](std::size_t k) {
            return sum_of_rows(shared_gradients.data(), int(shared_gradients.size()) / row, row, int(k));
        };
        for (std::size_t k = 0; k < shared.size(); ++k) shared[k] = sum(k);
        for (std::size_t v = 0; views[0].gather_camera_gradient && v < views.size(); ++v) {
            CameraGradient<double> camera;
            const std::size_t first = shared.size() + v * CameraGradient<double>::kSize;
            camera.for_each([&](int k, double& number) { number = sum(first + std::size_t(k)); });
            camera_gradients_.push_back({views[v].target.id, camera});
        }
        leave_out_common(step_shared(update_args(views[0], state_.step, 1, int(views.size())), shared));
    }
    /// Times stages in any step: reading the clock costs nothing on the CPU.
    std::vector<StageCost> measure_stages(std::optional<int> pass) override {
        if (pass && *pass > 0) return {};
        auto& s = raster_.seconds;
        const double gaussians = work_.gaussians, pairs = work_.pairs;
        const ModelInfo& info = appearance_model(state_.appearance.model);
        // In a mixed model the cost of a residual is averaged over all Gaussians.
        const double share =
            state_.active_degree > 0 && state_.count > 0 ? double(state_.num_residuals()) / double(state_.count) : 0;
        const double values = 14.0 + share * state_[Group::kResidual].width;  // used parameters of a Gaussian
        const double operations = share * info.operations, operations_backward = share * info.operations_backward;
        // The geometry of every Gaussian is read, its colour only if it is in view. The sort by depth has three passes,
        // which read and write a key of 8 bytes, and finds the tiles of a Gaussian from 8 bytes.
        const double geometry_bytes = 4 * 11, color_bytes = 4 * (values - 11);
        // Instructions as counted in the templates: forward fragment_alpha 17 (10 of them for exp2) + blend_fragment
        // 10, backward fragment_alpha 17 + blend_fragment_backward 32. A splat has 40 bytes, its sums 36.
        std::vector<StageCost> costs = {
            {"preprocess", s.preprocess, gaussians, "Gaussian",
             gaussians * (geometry_bytes + 4) + work_.visible * (color_bytes + 40 + 4 + 8) + work_.instances * 4,
             work_.visible * (260 + operations),
             "colours and the lists of tiles are made one Gaussian at a time; rows of the Gaussians in view are read "
             "from scattered places",
             true},
            {"sort", s.sort, work_.instances, "instance", work_.visible * (3 * 16 + 8) + work_.instances * (4 + 8),
             work_.instances * 4,
             "each pass reads its items twice and writes them to scattered places; the floor assumes streaming"},
            {"blend", s.blend, pairs, "pixel x Gaussian", work_.instances * (8 + 40 + 2) + work_.pixels * 16,
             pairs * 27, ""},
            {"loss", loss_seconds_, work_.pixels, "pixel", work_.pixels * 3 * 4 * 16,
             work_.pixels * 3 * (110 + 68 + 40 + 70), "each image row is read eleven times from the cache"},
            {"blend backward", s.blend_backward, pairs, "pixel x Gaussian",
             work_.instances * (8 + 40 + 2 + 36) + work_.pixels * 28, pairs * 51, ""},
            {"Gaussian backward + Adam", update_seconds_, gaussians, "Gaussian",
             work_.moving * 24 * values + work_.instances * 36,
             work_.visible * (500 + operations_backward) + work_.moving * 10 * values,
             "one Gaussian at a time in scalar code; the floor assumes full vectors", true}};
        // A pixel takes 235 instructions forward (six powers of 25 each), and backward the same plus 300.
        if (work_.corrected_pixels > 0)
            costs.push_back({"PPISP", correction_seconds_, work_.corrected_pixels, "pixel",
                             work_.corrected_pixels * 3 * 4 * 5, work_.corrected_pixels * 770,
                             "powers and logarithms in scalar code; the floor assumes full vectors"});
        s = {};
        loss_seconds_ = update_seconds_ = correction_seconds_ = 0;
        work_ = {};
        return pass ? std::vector<StageCost>{} : costs;
    }

  private:
    using Gradient = typename CpuRasterizer<float, Model>::FullGradient;

    void leave_out_common(std::int64_t gradients) {
        stats_.num_nonfinite_gradients += gradients;
        stats_.num_nonfinite_common += gradients;
    }

    /// Returns the splats of all parts in one contiguous array.
    std::span<const WireSplat> in_a_row(const SplatParts& parts) {
        if (parts.size() == 1) return parts[0]->values();
        joined_.clear();
        for (const auto* part : parts) joined_.insert(joined_.end(), part->values().begin(), part->values().end());
        return joined_;
    }

    /// Renders a view of `splats`, or of the model if they are null.
    void forward(const RenderRequest& r, const SplatParts* splats, float* image, float* transmittance) {
        if (splats)
            raster_.forward(in_a_row(*splats), r.camera, r.background, image, transmittance);
        else
            raster_.forward(ParameterView<float>::of(state_), r.camera, r.background, state_.active_degree, r.mode,
                            image, transmittance);
    }

    /// Computes the gradient sums of all splats from dL_dimage_.
    void backward(bool corrected) {
        if (corrected) {
            const StageTimer timer(correction_seconds_);
            correction_.backward(image_.data(), dL_dimage_.data());
        }
        raster_.backward(image_.data(), transmittance_.data(), dL_dimage_.data());
    }

    /// Renders the view into image_ and, if `corrected`, its corrected image into corrected_. Makes room in dL_dimage_.
    void view_image(const StepRequest& r, bool corrected, const SplatParts* splats = nullptr) {
        const std::size_t pixels = std::size_t(r.camera.width) * r.camera.height;
        image_.resize(3 * pixels);
        transmittance_.resize(pixels);
        dL_dimage_.resize(3 * pixels);
        forward({r.camera, r.background}, splats, image_.data(), transmittance_.data());
        if (corrected) {
            const StageTimer timer(correction_seconds_);
            work_.corrected_pixels += double(pixels);
            corrected_.resize(3 * pixels);
            correction_.apply(state_.ppisp, r.isp, image_.data(), r.camera.width, r.camera.height, corrected_.data());
        }
    }

    /// Does the same, and writes the gradient of the loss by the final image to dL_dimage_.
    ViewLoss view_loss(const StepRequest& r, bool corrected, const SplatParts* splats = nullptr) {
        view_image(r, corrected, splats);
        const StageTimer timer(loss_seconds_);
        return loss_.compute((corrected ? corrected_ : image_).data(), r.target, r.background, r.loss,
                             dL_dimage_.data());
    }

    /// Records the loss. Returns false if it is not finite, so that the step must be skipped.
    bool note_loss(const ViewLoss& loss) {
        stats_.loss = loss.loss, stats_.l1 = loss.l1, stats_.ssim = loss.ssim;
        stats_.num_instances = raster_.num_instances();
        ++stats_.steps;
        const bool finite = std::isfinite(loss.loss);
        stats_.consecutive_skips = finite ? 0 : stats_.consecutive_skips + 1;
        return finite;
    }

    void count_work(const StepRequest& r) {
        const std::size_t pixels = transmittance_.size();
        work_.gaussians += double(state_.count);
        work_.visible += double(raster_.num_visible());
        work_.moving += double(r.only_visible ? raster_.num_visible() : state_.count);
        work_.instances += double(raster_.num_instances());
        work_.pixels += double(pixels);
        work_.pairs += double(kLanes) * double(raster_.num_lane_operations());
    }

    void update(const StepRequest& r, const ParameterView<float>& params) {
        const int width = state_[Group::kResidual].width;
        const UpdateArgs args = update_args(r, state_.step, state_.count);
        begin_cameras(r, 1);
        update_all(r, args, [&](std::int64_t part, const ModelArrays& arrays) {
            return [&, part, arrays](std::int64_t i, Gradient& gradient, float* dL_dshared) {
                raster_.gaussian_gradient(params, i, r.gather_camera_gradient, gradient, dL_dshared);
                const bool finite = drop_nonfinite(gradient, gradient.residual, i < params.num_residuals ? width : 0);
                if (finite) add_gradient_statistic(arrays, r.camera.width, r.camera.height, i, gradient);
                if (r.gather_camera_gradient) add_to_camera(part, 0, gradient);
                return finite;
            };
        });
        if (r.gather_camera_gradient) camera_gradients_.push_back({r.target.id, sum_of_camera(0)});
        leave_out_common(step_shared(args, sum_shared()));
    }

    /// Starts or stops recording the last step of each Gaussian. All Gaussians are up to date when it starts.
    void keep_last_steps(const StepRequest& r) {
        if (!r.only_visible)
            state_.last_step.clear();
        else if (state_.last_step.empty())
            state_.last_step.assign(state_.count, float(state_.step));
    }

    /// Takes the step of all rows. gradients_of(part, arrays) returns a function that computes the gradient of each row
    /// of that part in turn, adds the row's gradient of the shared weights, and returns false if it dropped a gradient
    /// that was not finite.
    template <class GradientsOf>
    void update_all(const StepRequest& r, const UpdateArgs& args, GradientsOf&& gradients_of) {
        const StageTimer timer(update_seconds_);
        if (r.gather_gradient_stats) {
            state_.gradient_sum.resize(state_.count, 0.0f);
            state_.gradient_count.resize(state_.count, 0.0f);
        }
        ModelArrays arrays{};
        for (int g = 0; g < kNumGroups; ++g) {
            auto& group = state_.groups[g];
            arrays.param[g] = group.param.data(), arrays.m[g] = group.m.data(), arrays.v[g] = group.v.data(),
            arrays.width[g] = group.width;
        }
        if (r.only_visible) arrays.last_step = state_.last_step.data();
        if (r.gather_gradient_stats)
            arrays.gradient_sum = state_.gradient_sum.data(), arrays.gradient_count = state_.gradient_count.data();
        const std::int64_t parts = num_parts(state_.count), num_residuals = state_.num_residuals();
        nonfinite_.assign(parts, 0);
        dL_dshared_.assign(parts * kNumSharedOf<Model>, 0.0f);
        parallel_for(parts, [&](std::int64_t part) {
            auto gradient_of = gradients_of(part, arrays);
            Gradient gradient;
            for (std::int64_t i = part * kPartSize, end = std::min(state_.count, i + kPartSize); i < end; ++i) {
                if (!gradient_of(i, gradient, dL_dshared_.data() + part * kNumSharedOf<Model>)) ++nonfinite_[part];
                const float turns = args.turns(arrays, i, gradient.visible);
                update_gaussian(arrays, args, i, turns, gradient);
                if (i < num_residuals && turns > 0) update_residual(arrays, args, i, turns, gradient.residual);
            }
        });
        for (std::int64_t n : nonfinite_) stats_.num_nonfinite_gradients += n;
    }

    /// Prepares the sums of the gradients of the cameras of a step's views, if it gathers them.
    void begin_cameras(const StepRequest& r, std::size_t num_views) {
        if (r.gather_camera_gradient)
            camera_sums_.assign(num_views * std::size_t(num_parts(state_.count)), CameraGradient<double>{});
    }
    /// Adds a Gaussian of a part of the rows to the gradient of the camera of view v.
    void add_to_camera(std::int64_t part, std::size_t v, const Gradient& gradient) {
        if (!gradient.visible) return;
        float numbers[CameraGradient<float>::kSize];
        gradient.of_camera().for_each([&](int k, float number) { numbers[k] = number; });
        camera_sums_[v * std::size_t(num_parts(state_.count)) + std::size_t(part)].for_each(
            [&](int k, double& sum) { sum += numbers[k]; });
    }
    /// Returns the gradient of the camera of view v after update_all.
    CameraGradient<double> sum_of_camera(std::size_t v) {
        CameraGradient<double> sum{};
        const std::size_t parts = std::size_t(num_parts(state_.count));
        for (std::size_t part = 0; part < parts; ++part) {
            double numbers[CameraGradient<double>::kSize];
            camera_sums_[v * parts + part].for_each([&](int k, double number) { numbers[k] = number; });
            sum.for_each([&](int k, double& number) { number += numbers[k]; });
        }
        return sum;
    }
    /// Returns the length of a rank's row of gradients that all ranks share.
    static std::size_t row_of_step(const std::vector<StepRequest>& views) {
        return shared_row(kNumSharedOf<Model>, views[0].gather_camera_gradient ? views.size() : 0);
    }

    /// Returns the gradient of the shared weights after update_all.
    std::vector<float> sum_shared() const {
        std::vector<float> sums(kNumSharedOf<Model>);
        for (std::size_t k = 0; k < sums.size(); ++k) {
            double sum = 0;
            for (std::size_t at = k; at < dL_dshared_.size(); at += sums.size()) sum += dL_dshared_[at];
            sums[k] = float(sum);
        }
        return sums;
    }

    std::int64_t step_shared(const UpdateArgs& args, const std::vector<float>& gradient) {
        auto& shared = state_.shared;
        std::int64_t num_nonfinite = 0;
        for (std::size_t k = 0; k < gradient.size(); ++k)
            if (!update_shared(shared.param[k], shared.m[k], shared.v[k], gradient[k], args.shared_step,
                               args.shared_gains))
                ++num_nonfinite;
        return num_nonfinite;
    }

    /// Takes one step of the residual of Gaussian i; for `turns` see update_gaussian.
    static void update_residual(const ModelArrays& a, const UpdateArgs& u, std::int64_t i, float turns,
                                const float* dL_dresidual) {
        const int k = int(Group::kResidual), width = a.width[k];
        float *p = a.param[k] + i * width, *m = a.m[k] + i * width, *v = a.v[k] + i * width;
        if (turns > 1) {
            const float decay = u.decay(turns);
#pragma omp simd
            for (int c = 0; c < width; ++c) v[c] *= decay;
        }
        if (u.per_column) {
            for (int c = 0; c < width; ++c)
                adam_update(p[c], m[c], v[c], dL_dresidual[c], u.residual_steps[c], u.gains);
            return;
        }
        const AdamStep<float> t = u.steps[k];
        const AdamGains<float> gains = u.gains;
#pragma omp simd
        for (int c = 0; c < width; ++c) adam_update(p[c], m[c], v[c], dL_dresidual[c], t, gains);
    }

    Gaussians state_;
    CpuRasterizer<float, Model> raster_;
    ImageLoss<float> loss_;
    ViewCorrection correction_;
    std::vector<float> image_, transmittance_, dL_dimage_;
    std::vector<float> corrected_;                     ///< image_ after PPISP, if PPISP is active
    std::vector<float> dL_dshared_;                    ///< (parts, shared weights), so that the sum has a fixed order
    std::vector<CameraGradient<double>> camera_sums_;  ///< (views, parts) of a step that gathers them
    std::vector<ViewCameraGradient> camera_gradients_;
    std::vector<std::int64_t> nonfinite_;
    StepStats stats_;
    struct {
        CameraParams<float> camera;
        RenderMode mode;
    } projection_{};  ///< the projection begun
    std::deque<std::vector<ViewReport>> unread_reports_;
    StepDecision decision_ = StepDecision::kTake;  ///< decision on the last step
    std::vector<WireSplat> joined_;                ///< splats of a view, from all ranks
    double loss_seconds_ = 0, update_seconds_ = 0, correction_seconds_ = 0;
    struct {
        double gaussians = 0, visible = 0, moving = 0, instances = 0, pixels = 0, pairs = 0, corrected_pixels = 0;
    } work_;  ///< work of the steps of a pass
};

}  // namespace gs
