// SPDX-License-Identifier: Apache-2.0
// The CUDA backend of one appearance model. Only the two preprocess kernels depend on the model.
#pragma once

#include <algorithm>

#include "kernels/blend/blend_cuda.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/densify_cuda.h"
#include "kernels/loss/loss_cuda.h"
#include "kernels/optimizer/update_device.h"
#include "kernels/sort/binning_cuda.h"

namespace gs {

inline constexpr int kGaussianBlock = 128;

struct PreprocessArgs {
    ParameterView<float> params;
    CameraParams<float> camera;
    int degree, width_padded, height_padded;
    RenderMode mode;
};

template <class Model>
__global__ void __launch_bounds__(kGaussianBlock) preprocess_forward(PreprocessArgs a, Splat<float>* __restrict__ splats, SplatBounds* __restrict__ bounds,
                                                                     std::uint32_t* __restrict__ depth_keys) {
    const std::int64_t i = std::int64_t(blockIdx.x) * kGaussianBlock + threadIdx.x;
    if (i >= a.params.count) return;
    const GaussianGeometry<float> g = a.params.geometry(i);
    Splat<float> s;
    PixelBounds b;
    float depth;
    if (!make_splat(g, a.camera, a.width_padded, a.height_padded, s, b, depth)) {
        bounds[i] = {0, 0, 0, 0};
        depth_keys[i] = 0xffffffffu; // sorts behind every visible one
        return;
    }
    s.color = gaussian_color<Model>(a.params, i, g.mean, a.camera.position, a.degree, a.mode);
    splats[i] = s;
    bounds[i] = {std::uint16_t(b.x_min), std::uint16_t(b.x_max), std::uint16_t(b.y_min), std::uint16_t(b.y_max)};
    depth_keys[i] = __float_as_uint(depth); // positive floats order like their bits
}

__device__ inline SplatSums<float> unpack(const PackedSums& p) {
    return {p.a.x, p.a.y, p.a.z, p.a.w, p.b.x, p.b.y, p.b.z, p.b.w, p.c.x};
}

template <class Model>
__global__ void __launch_bounds__(kGaussianBlock) preprocess_backward(PreprocessArgs a, const Splat<float>* __restrict__ splats, const SplatBounds* __restrict__ bounds,
                                                                      const PackedSums* __restrict__ sums, ModelArrays arrays, UpdateArgs update,
                                                                      unsigned long long* __restrict__ num_nonfinite) {
    const std::int64_t i = std::int64_t(blockIdx.x) * kGaussianBlock + threadIdx.x;
    const bool valid = i < a.params.count;
    GaussianGradient<float, Model> gradient{};
    if (valid) {
        const SplatBounds b = bounds[i];
        if (b.x_max > b.x_min) gaussian_backward<Model>(a.params, i, a.camera, a.degree, splats[i], unpack(sums[i]), gradient);
        if (!update_gaussian<false>(arrays, update, i, gradient)) atomicAdd(num_nonfinite, 1ull);
    }
    if constexpr (Model::kMaxResidual > 0) {
        // Residual rows are long: a thread that walked its own row would touch 32 cache lines a warp at every column. The
        // warp's 32 rows are one contiguous piece, which it updates together, with the gradients passed through shared memory.
        constexpr int kStride = Model::kMaxResidual | 1; // odd: no bank conflicts
        __shared__ float residual[kGaussianBlock / 32][32 * kStride];
        const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, width = arrays.width[int(Group::kResidual)];
        for (int c = 0; c < width; ++c) residual[warp][lane * kStride + c] = gradient.residual[c];
        __syncwarp();
        const std::int64_t first = i - lane, rows = gs_min<std::int64_t>(32, a.params.count - first);
        const std::size_t base = std::size_t(first) * width;
        float *p = arrays.param[int(Group::kResidual)] + base, *m = arrays.m[int(Group::kResidual)] + base, *v = arrays.v[int(Group::kResidual)] + base;
        for (int k = lane; k < int(rows) * width; k += 32) {
            const int row = k / width, column = k - row * width;
            adam_update(p[k], m[k], v[k], residual[warp][row * kStride + column],
                        update.residual_steps ? update.residual_steps[column] : update.steps[int(Group::kResidual)]);
        }
    }
}

static __global__ void flag_nonfinite(std::int64_t n, const float* values, unsigned* flag) {
    const std::int64_t i = std::int64_t(blockIdx.x) * 256 + threadIdx.x;
    if (i < n && !isfinite(values[i])) *flag = 1; // all writers write the same
}

template <class Model> class CudaBackend final : public Backend {
  public:
    CudaBackend() { GS_CUDA(cudaStreamCreate(&stream_)); }
    ~CudaBackend() override { cudaStreamDestroy(stream_); }

    std::string describe() const override {
        cudaDeviceProp p;
        int device = 0;
        GS_CUDA(cudaGetDevice(&device));
        GS_CUDA(cudaGetDeviceProperties(&p, device));
        return std::string("CUDA, ") + p.name;
    }

    void upload(const Gaussians& state) override {
        meta_ = state;
        for (int g = 0; g < kNumGroups; ++g) {
            const auto& group = state.groups[g];
            meta_.groups[g].param.clear(), meta_.groups[g].m.clear(), meta_.groups[g].v.clear();
            param_[g].upload(group.param);
            for (auto [buffer, values] : {std::pair{&m_[g], &group.m}, {&v_[g], &group.v}}) {
                if (!values->empty())
                    buffer->upload(*values);
                else if (!group.param.empty())
                    GS_CUDA(cudaMemset(buffer->reserve(group.param.size()), 0, group.param.size() * sizeof(float)));
            }
        }
        gradient_sum_.upload(state.gradient_sum);
        gradient_count_.upload(state.gradient_count);
        GS_CUDA(cudaDeviceSynchronize());
    }
    Gaussians download(bool with_moments) const override {
        GS_CUDA(cudaDeviceSynchronize());
        Gaussians out = meta_;
        for (int g = 0; g < kNumGroups; ++g) {
            const std::size_t n = std::size_t(meta_.count) * meta_.groups[g].width;
            out.groups[g].param = param_[g].download(n);
            if (!with_moments) continue;
            out.groups[g].m = m_[g].download(n);
            out.groups[g].v = v_[g].download(n);
        }
        if (with_moments && !meta_.gradient_sum.empty()) {
            out.gradient_sum = gradient_sum_.download(meta_.count);
            out.gradient_count = gradient_count_.download(meta_.count);
        }
        return out;
    }
    std::int64_t count() const override { return meta_.count; }
    void set_active_degree(int degree) override { meta_.active_degree = degree; }

    void render(const RenderRequest& r, RenderedImage& out) override {
        const std::size_t pixels = std::size_t(r.camera.width) * r.camera.height;
        forward(r.camera, r.background, r.mode, false);
        out.width = r.camera.width, out.height = r.camera.height;
        out.rgb = image_.download(3 * pixels);
        out.alpha = transmittance_.download(pixels);
        for (float& t : out.alpha) t = 1 - t;
    }

    void step(const StepRequest& r) override {
        const int width = r.camera.width, height = r.camera.height;
        const std::size_t pixels = std::size_t(width) * height;
        CudaLossInput loss{nullptr, upload_target(r.target), r.background, r.lambda_dssim, double(pixels)};
        if (r.target.mask) {
            loss.weight_sum = 0;
            for (std::size_t i = 0; i < pixels; ++i) loss.weight_sum += r.target.mask[i] / 255.0;
        }
        const CudaBins bins = forward(r.camera, r.background, RenderMode::kFull, true);
        loss.image = image_.get();
        GS_CUDA(cudaMemsetAsync(totals_.reserve(2), 0, 2 * sizeof(double), stream_));
        loss_.compute(loss, dL_dimage_.reserve(3 * pixels), totals_.get(), stream_);
        double totals[2];
        GS_CUDA(cudaMemcpyAsync(totals, totals_.get(), sizeof totals, cudaMemcpyDeviceToHost, stream_));
        GS_CUDA(cudaStreamSynchronize(stream_));
        const double norm = loss.weight_sum > 0 ? 1 / (3 * loss.weight_sum) : 0;
        stats_.l1 = totals[0] * norm, stats_.ssim = totals[1] * norm;
        stats_.loss = norm > 0 ? (1 - r.lambda_dssim) * stats_.l1 + r.lambda_dssim * (1 - stats_.ssim) : 0;
        stats_.num_instances = bins.num_instances;
        ++stats_.steps;
        if (!std::isfinite(stats_.loss)) {
            ++stats_.consecutive_skips;
            return;
        }
        stats_.consecutive_skips = 0;
        const std::int64_t n = meta_.count;
        PackedSums* sums = sums_.reserve(std::max<std::int64_t>(n, 1));
        GS_CUDA(cudaMemsetAsync(sums, 0, n * sizeof(PackedSums), stream_));
        blend_.backward(bins, splats_.get(), bounds_.get(), width, height, r.background, image_.get(), transmittance_.get(), dL_dimage_.get(), sums, stream_);
        ++meta_.step;
        update(r, sums);
    }

    StepStats take_stats() override {
        const StepStats out = stats_;
        stats_.steps = 0;
        stats_.num_nonfinite_gradients = 0;
        return out;
    }
    std::vector<StageCost> take_stage_costs() override { return {}; }

    DensifyStats densify_mcmc(const McmcParams& params, std::int64_t iteration, std::uint64_t seed) override {
        // Opacities go to the host and a list of row moves comes back; the rows stay on the device.
        const std::int64_t n = meta_.count;
        GS_CUDA(cudaDeviceSynchronize());
        find_usable(n, param_[int(Group::kRotation)].get(), usable_.reserve(std::max<std::int64_t>(n, 1)), stream_);
        std::vector<float> raw_opacities = param_[int(Group::kOpacity)].download(n);
        const McmcPlan plan = plan_mcmc(raw_opacities, usable_.download(n), params, iteration, seed);
        mcmc_.apply(plan.relocate, arrays(), stream_);
        if (plan.count > n) {
            GS_CUDA(cudaStreamSynchronize(stream_));
            for (int g = 0; g < kNumGroups; ++g) {
                const std::size_t width = meta_.groups[g].width, used = n * width, room = std::size_t(params.cap) * width, grown = (plan.count - n) * width;
                param_[g].grow(room, used);
                for (auto* buffer : {&m_[g], &v_[g]}) {
                    buffer->grow(room, used);
                    if (grown) GS_CUDA(cudaMemsetAsync(buffer->get() + used, 0, grown * sizeof(float), stream_));
                }
            }
            meta_.count = plan.count;
            mcmc_.apply(plan.grow, arrays(), stream_);
        }
        GS_CUDA(cudaStreamSynchronize(stream_));
        return {std::int64_t(plan.relocate.to.size()), std::int64_t(plan.grow.to.size()), 0, 0, 0, meta_.count};
    }
    DensifyStats densify_adc(const AdcParams& params, std::int64_t iteration, std::uint64_t seed) override {
        return on_host([&](Gaussians& s) { return adc_densify(s, params, iteration, seed); });
    }
    void reset_opacity() override {
        on_host([](Gaussians& s) { return adc_reset_opacity(s), 0; });
    }
    void morton_sort() override {
        on_host([](Gaussians& s) { return gather_rows(s, morton_order(s)), 0; });
    }
    std::int64_t prune_nonfinite(std::int64_t by_group[kNumGroups]) override {
        std::fill_n(by_group, kNumGroups, 0);
        if (all_finite()) return 0; // the usual case needs no copy of the model
        return on_host([&](Gaussians& s) { return remove_nonfinite(s, by_group); });
    }
    std::int64_t prune_invisible() override {
        return on_host([](Gaussians& s) { return remove_invisible(s); });
    }

  private:
    bool all_finite() {
        unsigned* flag = flag_.reserve(1);
        GS_CUDA(cudaMemsetAsync(flag, 0, sizeof *flag, stream_));
        for (int g = 0; g < kNumGroups; ++g) {
            const std::int64_t n = meta_.count * meta_.groups[g].width;
            if (n == 0) continue;
            flag_nonfinite<<<num_blocks(n, 256), 256, 0, stream_>>>(n, param_[g].get(), flag);
            GS_CUDA_LAUNCHED("flag_nonfinite");
        }
        unsigned host = 0;
        GS_CUDA(cudaMemcpyAsync(&host, flag, sizeof host, cudaMemcpyDeviceToHost, stream_));
        GS_CUDA(cudaStreamSynchronize(stream_));
        return host == 0;
    }

    template <class Fn> auto on_host(Fn&& fn) {
        Gaussians s = download(true);
        auto result = fn(s);
        upload(s);
        return result;
    }

    ParameterView<float> view() const {
        const auto p = [&](Group g) { return param_[int(g)].get(); };
        return {meta_.count,      p(Group::kMean), p(Group::kScale),    p(Group::kRotation),
                p(Group::kOpacity), p(Group::kBase), p(Group::kResidual), meta_[Group::kResidual].width, meta_.appearance.activation};
    }
    ModelArrays arrays() const {
        ModelArrays a{};
        for (int g = 0; g < kNumGroups; ++g) a.param[g] = param_[g].get(), a.m[g] = m_[g].get(), a.v[g] = v_[g].get(), a.width[g] = meta_.groups[g].width;
        return a;
    }
    PreprocessArgs preprocess_args(const CameraParams<float>& camera, RenderMode mode) const {
        return {view(), camera, Model::kDirectional ? meta_.active_degree : 0, int(num_blocks(camera.width, kCudaTileX)) * kCudaTileX,
                int(num_blocks(camera.height, kCudaTileY)) * kCudaTileY, mode};
    }

    CudaBins forward(const CameraParams<float>& camera, Vec3<float> background, RenderMode mode, bool for_backward) {
        if (std::max(camera.width, camera.height) > 65535 - 2 * kCudaTileX)
            throw DeviceError("image of " + std::to_string(camera.width) + "x" + std::to_string(camera.height) + " pixels: the CUDA backend takes up to 65503 a side");
        const std::int64_t n = meta_.count;
        const std::size_t pixels = std::size_t(camera.width) * camera.height, room = std::max<std::int64_t>(n, 1);
        splats_.reserve(room), bounds_.reserve(room), depth_keys_.reserve(room);
        if (n > 0) {
            preprocess_forward<Model><<<num_blocks(n, kGaussianBlock), kGaussianBlock, 0, stream_>>>(preprocess_args(camera, mode), splats_.get(), bounds_.get(), depth_keys_.get());
            GS_CUDA_LAUNCHED("preprocess_forward");
        }
        const CudaBins bins = binning_.build(n, splats_.get(), bounds_.get(), depth_keys_.get(), camera.width, camera.height, stream_);
        blend_.forward(bins, splats_.get(), bounds_.get(), camera.width, camera.height, background, image_.reserve(3 * pixels), transmittance_.reserve(pixels),
                       for_backward, stream_);
        return bins;
    }

    TargetImage upload_target(const TargetImage& t) {
        TargetImage d = t;
        const std::size_t pixels = std::size_t(t.width) * t.height, values = pixels * t.channels;
        const auto copy = [&](auto& buffer, const auto* host, std::size_t n) {
            auto* memory = buffer.reserve(n);
            GS_CUDA(cudaMemcpyAsync(memory, host, n * sizeof *host, cudaMemcpyHostToDevice, stream_));
            return memory;
        };
        if (t.u8) d.u8 = copy(target_u8_, t.u8, values);
        if (t.f32) d.f32 = copy(target_f32_, t.f32, values);
        if (t.mask) d.mask = copy(mask_, t.mask, pixels);
        return d;
    }

    void update(const StepRequest& r, const PackedSums* sums) {
        const std::int64_t n = meta_.count;
        if (n == 0) return;
        UpdateArgs args = update_args(r, meta_.step, n);
        std::vector<AdamStep<float>> columns;
        for (double rate : r.residual_rates) columns.push_back(AdamStep<float>::at(rate, meta_.step));
        if (!columns.empty()) {
            columns_.upload(columns, stream_);
            args.residual_steps = columns_.get();
        }
        ModelArrays model = arrays();
        if (r.gather_gradient_stats) {
            if (meta_.gradient_sum.empty()) { // first step since the last densification
                meta_.gradient_sum.resize(1);
                GS_CUDA(cudaMemsetAsync(gradient_sum_.reserve(n), 0, n * sizeof(float), stream_));
                GS_CUDA(cudaMemsetAsync(gradient_count_.reserve(n), 0, n * sizeof(float), stream_));
            }
            model.gradient_sum = gradient_sum_.get(), model.gradient_count = gradient_count_.get();
        }
        GS_CUDA(cudaMemsetAsync(nonfinite_.reserve(1), 0, sizeof(unsigned long long), stream_));
        preprocess_backward<Model><<<num_blocks(n, kGaussianBlock), kGaussianBlock, 0, stream_>>>(preprocess_args(r.camera, RenderMode::kFull), splats_.get(), bounds_.get(),
                                                                                                 sums, model, args, nonfinite_.get());
        GS_CUDA_LAUNCHED("preprocess_backward");
        unsigned long long bad = 0;
        GS_CUDA(cudaMemcpyAsync(&bad, nonfinite_.get(), sizeof bad, cudaMemcpyDeviceToHost, stream_));
        GS_CUDA(cudaStreamSynchronize(stream_));
        stats_.num_nonfinite_gradients += std::int64_t(bad);
    }

    cudaStream_t stream_ = nullptr;
    Gaussians meta_; ///< all but the arrays, which live on the device
    DeviceBuffer<float> param_[kNumGroups], m_[kNumGroups], v_[kNumGroups], gradient_sum_, gradient_count_;
    DeviceBuffer<Splat<float>> splats_;
    DeviceBuffer<SplatBounds> bounds_;
    DeviceBuffer<std::uint32_t> depth_keys_;
    DeviceBuffer<PackedSums> sums_;
    DeviceBuffer<float> image_, transmittance_, dL_dimage_, target_f32_;
    DeviceBuffer<std::uint8_t> target_u8_, mask_;
    DeviceBuffer<double> totals_;
    DeviceBuffer<unsigned long long> nonfinite_;
    DeviceBuffer<unsigned> flag_;
    DeviceBuffer<char> usable_;
    CudaMcmc mcmc_;
    DeviceBuffer<AdamStep<float>> columns_;
    CudaBinning binning_;
    CudaBlend blend_;
    CudaLoss loss_;
    StepStats stats_;
};

}  // namespace gs
