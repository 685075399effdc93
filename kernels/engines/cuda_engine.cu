// SPDX-License-Identifier: Apache-2.0
// The host side of the CUDA engine: lays out memory, launches the stages, and repeats steps that did not fit.
#include "kernels/engines/cuda_engine.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

#include "appearance/model_info.h"
#include "kernels/base/half_range.h"
#include "kernels/blend/blend_cuda.h"
#include "kernels/cuda/cuda_device.h"
#include "kernels/densify/rows_cuda.h"
#include "kernels/loss/loss_cuda.h"
#include "kernels/splat/smoothing_device.h"

namespace gs {
namespace {

/// Largest number of instances of a view. The sort's index of an instance is a signed 32-bit integer.
constexpr unsigned long long kMaxInstances = 0x7fffffff;
/// Largest side of an image in pixels. Pixel bounds have 16 bits and are padded to whole tiles.
constexpr int kMaxSide = 65535 - 2 * kCudaTileX;
/// Threads per block of kernels that process single values.
constexpr int kBlock = 256;

std::uint32_t bits_of(float x) {
    std::uint32_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    return bits;
}

__global__ void __launch_bounds__(kLossSumThreads)
    report_step(const StepControl* control, CudaLossSums sums, const float* of_camera, StepStatus* status) {
    const double2 loss = add_up(sums);
    if (of_camera && threadIdx.x < CameraGradient<float>::kSize)
        status->of_camera[threadIdx.x] = of_camera[threadIdx.x];
    if (threadIdx.x > 0) return;
    status->num_instances = control->num_instances;
    status->num_pairs = control->num_pairs;
    status->l1_sum = loss.x, status->ssim_sum = loss.y;
    status->num_visible = control->num_visible;
    status->num_nonfinite = control->num_nonfinite;
    status->stopped = control->stopped;
}

/// Writes the unit rays (H,W) of the pixels of a lens.
__global__ void compute_rays(CameraParams<float> camera, float4* __restrict__ rays) {
    const std::size_t i = std::size_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i >= std::size_t(camera.width) * camera.height) return;
    const float x = float(i % camera.width) + 0.5f, y = float(i / camera.width) + 0.5f;
    const Vec3<float> ray = lens_ray(camera.lens, (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
    rays[i] = make_float4(ray.x, ray.y, ray.z, 0);
}

cudaStream_t make_stream() {
    cudaStream_t stream;
    GS_CUDA(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
    return stream;
}

/// Returns a group's moments packed as one word per pair (packed_moments.h), rounded to nearest.
template <class Group> std::vector<float> packed(const Group& group) {
    std::vector<float> words(group.m.size());
    for (std::size_t i = 0; i < words.size(); ++i) {
        const std::uint32_t word = pack_moments(bits_of(group.m[i]), bits_of(group.v[i]), 0x8000);
        std::memcpy(&words[i], &word, sizeof word);
    }
    return words;
}

/// Unpacks the words in a group's m into both moments.
template <class Group> void unpack(Group& group) {
    group.v.resize(group.m.size());
    for (std::size_t i = 0; i < group.m.size(); ++i) {
        const std::uint32_t word = bits_of(group.m[i]), m = first_moment_bits(word), v = second_moment_bits(word);
        std::memcpy(&group.m[i], &m, sizeof m);
        std::memcpy(&group.v[i], &v, sizeof v);
    }
}

__global__ void find_smoothing(std::int64_t n, const float* means, const CameraParams<float>* cameras, int num_cameras,
                               float* out) {
    const std::int64_t i = std::int64_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i >= n) return;
    out[i] = smoothing_variance(Vec3<float>{means[3 * i], means[3 * i + 1], means[3 * i + 2]}, cameras, num_cameras);
}

__global__ void round_to_half(std::size_t n, const float* values, __half* out) {
    const std::size_t i = std::size_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i < n) out[i] = __float2half_rn(gs_clamp(values[i], -float(kLargestHalf), float(kLargestHalf)));
}

__global__ void fill_values(std::int64_t n, float value, float* out) {
    const std::int64_t i = std::int64_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i < n) out[i] = value;
}

/// Divisor of the extra room for splats: if a view needs more room than there is, 1/16 more is allocated.
constexpr std::int64_t kMoreSplats = 16;

/// Returns the room to allocate for so many instances, with a margin.
std::int64_t room_for(std::int64_t num_instances) {
    return std::min(num_instances + num_instances / 4 + 1024, std::int64_t(kMaxInstances));
}

int padded(int size, int tile) { return (size + tile - 1) / tile * tile; }

}  // namespace

CudaEngine::CudaEngine(const ModelKernels& kernels, const EngineOptions& options)
    : kernels_(kernels),
      options_(options),
      cutoffs_(Cutoffs<float>::of(options.min_alpha, options.min_transmittance)),
      stream_(make_stream()),
      lazy_(model_, stream_),
      images_(options.image_budget, kInFlight) {
    model_.packed_moments = options.packed_moments;
    GS_CUDA(cudaMallocHost(&statuses_, kInFlight * sizeof(StepStatus)));
    for (cudaEvent_t& e : done_) GS_CUDA(cudaEventCreateWithFlags(&e, cudaEventDisableTiming));
    GS_CUDA(cudaMemsetAsync(control_.reserve(1), 0, sizeof(StepControl), stream_));
    cudaDeviceProp p;
    int device = 0;
    GS_CUDA(cudaGetDevice(&device));
    GS_CUDA(cudaGetDeviceProperties(&p, device));
    traits_ = {.device = std::string("CUDA, ") + p.name + (options_.deterministic ? ", deterministic" : "") +
                         (options_.separate_appearance ? ", separate appearance" : ""),
               .stream = &device_stream_,
               .stage_passes = StageTimes::kPasses,
               .ceilings = &cuda_ceilings};
}

CudaEngine::~CudaEngine() {
    cudaStreamSynchronize(stream_);
    for (cudaEvent_t e : done_) cudaEventDestroy(e);
    cudaFreeHost(statuses_);
    cudaStreamDestroy(stream_);
}

// --- the model ------------------------------------------------------------------------------------------------------

void CudaEngine::upload(const Gaussians& state) {
    abandon_steps();  // they belong to the old model
    stats_ = {};
    model_.count = model_.without_residual = 0;
    model_.broken = true;  // stays true if memory runs out
    meta_ = Gaussians{};
    meta_.appearance = state.appearance, meta_.active_degree = state.active_degree, meta_.step = state.step;
    meta_.antialiased = state.antialiased;
    for (int g = 0; g < kNumGroups; ++g) {
        const auto& group = state.groups[g];
        meta_.groups[g].width = model_.width[g] = group.width;
        model_.param[g].upload(group.param);
        if (model_.moments(g).size() == 1) {
            model_.m[g].upload_or_zero(group.m.empty() ? group.m : packed(group), group.param.size());
            continue;
        }
        model_.m[g].upload_or_zero(group.m, group.param.size());
        model_.v[g].upload_or_zero(group.v, group.param.size());
    }
    meta_.shared.width = state.shared.width;
    if (state.shared.width != kernels_.shared.count)
        throw UsageError("the model holds " + std::to_string(state.shared.width) +
                         " shared weights, but its appearance model has " + std::to_string(kernels_.shared.count));
    if (kernels_.shared.count > 0) {
        const std::size_t n = std::size_t(kernels_.shared.count);
        model_.shared_param.upload(state.shared.param);
        model_.shared_m.upload_or_zero(state.shared.m, n);
        model_.shared_v.upload_or_zero(state.shared.v, n);
        const std::size_t words = std::size_t(kernels_.shared.prepared_words);
        GS_CUDA(cudaMemsetAsync(model_.shared_prepared.reserve(words), 0, words * sizeof(unsigned), stream_));
        kernels_.shared.prepare(model_.shared_param.get(), model_.shared_prepared.get(), stream_);
    }
    model_.has_statistic = !state.gradient_sum.empty();
    model_.gradient_sum.upload(state.gradient_sum);
    model_.gradient_count.upload(state.gradient_count);
    model_.has_last_step = !state.last_step.empty();
    if (model_.has_last_step) model_.last_step.reserve(model_.row_capacity());
    model_.last_step.upload(state.last_step);
    ppisp_.upload(state.ppisp);
    sizes_ = {};  // PPISP takes some of the scratch block
    model_.count = state.count;
    model_.broken = false;
    model_.without_residual = state.count - state.num_rows(Group::kResidual);
    half_residuals_current_ = false;
    lazy_.reset(meta_.step);
    GS_CUDA(cudaDeviceSynchronize());
}

Gaussians CudaEngine::download(Download what) {
    if (model_.broken) throw DeviceError("the model was lost when memory ran out while its rows were moved");
    const bool with_moments = what == Download::kAll;
    if (with_moments || what == Download::kParameters)
        settle();
    else
        synchronize();
    GS_CUDA(cudaStreamSynchronize(stream_));
    Gaussians out = meta_;
    out.count = model_.count;
    if (what == Download::kBases)
        return out[Group::kBase].param = model_.param[int(Group::kBase)].download(3 * model_.count), out;
    out.ppisp = ppisp_.download(with_moments || what == Download::kPpisp);
    if (what == Download::kPpisp) return out;
    for (int g = 0; g < kNumGroups; ++g) {
        const std::size_t n = model_.floats(g);
        out.groups[g].param = model_.param[g].download(n);
        if (!with_moments) continue;
        out.groups[g].m = model_.m[g].download(n);
        if (model_.moments(g).size() == 1)
            unpack(out.groups[g]);
        else
            out.groups[g].v = model_.v[g].download(n);
    }
    const std::size_t shared = std::size_t(kernels_.shared.count);
    out.shared.param = model_.shared_param.download(shared);
    if (with_moments) out.shared.m = model_.shared_m.download(shared), out.shared.v = model_.shared_v.download(shared);
    if (with_moments && model_.has_statistic) {
        out.gradient_sum = model_.gradient_sum.download(model_.count);
        out.gradient_count = model_.gradient_count.download(model_.count);
    }
    if (with_moments && model_.has_last_step) out.last_step = model_.last_step.download(model_.count);
    return out;
}

void CudaEngine::set_active_degree(int degree) {
    if (degree == meta_.active_degree) return;
    synchronize();  // a repeated step must see the degree with which it began
    meta_.active_degree = degree;
}

void CudaEngine::update_smoothing(const std::vector<CameraParams<float>>& cameras) {
    if (!model_.smoothing() || model_.count == 0) return;
    synchronize();  // a repeated step must see the filter with which it began
    DeviceBuffer<CameraParams<float>> on_device;
    on_device.upload(cameras);
    find_smoothing<<<num_blocks(model_.count, kBlock), kBlock, 0, stream_>>>(
        model_.count, model_.param[int(Group::kMean)].get(), on_device.get(), int(cameras.size()), model_.smoothing());
    GS_CUDA_LAUNCHED("find_smoothing");
    GS_CUDA(cudaStreamSynchronize(stream_));
}

void CudaEngine::upload_ppisp(const PpispState& state) {
    synchronize();  // a repeated step must see the PPISP with which it began
    GS_CUDA(cudaStreamSynchronize(stream_));
    ppisp_.upload(state);
    sizes_ = {};  // PPISP takes some of the scratch block
    GS_CUDA(cudaDeviceSynchronize());
}

// --- one forward pass -----------------------------------------------------------------------------------------------

void CudaEngine::take(Carver& c, const Sizes& sizes) {
    const auto take_shared_sums = [&] {
        const std::size_t rows = num_blocks(sizes.n, kernels_.shared.gaussians_per_sum);
        shared_sums_.values = c.take<float>(rows * std::size_t(kernels_.shared.count));
        shared_sums_.is_set = c.take<std::uint8_t>(rows);
    };
    if (sizes.layout == Layout::kSharedSums) return take_shared_sums();
    const bool for_step = sizes.layout == Layout::kStep;
    const std::size_t pixels = std::size_t(sizes.width) * sizes.height;
    const int tiles = padded(sizes.width, kCudaTileX) / kCudaTileX * (padded(sizes.height, kCudaTileY) / kCudaTileY);
    splats_ = c.take<PackedSplat>(sizes.n);
    separate_ = {};
    if (options_.separate_appearance && kernels_.directional) separate_.residuals = c.take<Vec3<float>>(sizes.n);
    if (sizes.layout == Layout::kProjection) {
        wire_.rows = c.take<std::uint32_t>(sizes.n);
        return binning_.take_counts(c, sizes.n);
    }
    image_ = c.take<float>(3 * pixels);
    transmittance_ = c.take<float>(pixels);
    ppisp_.take(c, sizes.width, sizes.height, for_step);
    binning_.take_results(c, sizes.n, sizes.capacity, sizes.width, sizes.height, options_.deterministic);
    // Buffers used only by binning share memory with buffers that are needed only after it.
    std::size_t at = c.at();
    const std::size_t input_end = binning_.take_temporaries(c);
    if (sizes.placed > 0) {
        // Splats are read before the sort writes here.
        c.rewind(std::max(input_end, sizes.splats_from));
        wire_.splats = c.take<WireSplat>(std::size_t(sizes.placed));
        // When sums are packed, only the sums of this view are read, which lie behind them.
        c.rewind(sizes.sums_from);
        wire_.sums = c.take<SplatSums<float>>(std::size_t(sizes.placed));
        wire_.sums_end = c.at();
        at = std::max(at, c.at());
    }
    if (!for_step) return;
    c.rewind(at);
    sums_ = c.take<PackedSums>(sizes.n);
    // In a fixed order sums are written, not added to, and the sums of invisible Gaussians are never read.
    blend_.take(c, sizes.capacity, tiles, sums_, options_.deterministic ? 0 : sizes.n);
    if (kernels_.shared.count > 0) take_shared_sums();
    if (options_.separate_appearance && kernels_.directional) {
        separate_.dL_dresiduals =
            c.take<float>(std::size_t(std::min(sizes.n, model_.num_residuals())) * model_.width[int(Group::kResidual)]);
        separate_.dL_dmeans = c.take<Vec3<float>>(sizes.n);
    }
    dL_dimage_ = c.take<float>(3 * pixels);
    loss_.take(c, sizes.width, sizes.height);
    if (options_.deterministic) blend_.take_partial_sums(c, sizes.capacity);
}

void CudaEngine::lay_out(const Sizes& sizes) {
    if (sizes == sizes_) return;
    sizes_ = {};  // stays empty if memory runs out
    // The number of splats varies with the view, and would force new allocations again and again. The room for a model
    // changes only with the model.
    Sizes some_more = sizes;
    if (sizes.n != model_.count)
        some_more.n = std::max(sizes.n, std::min(sizes.n + sizes.n / kMoreSplats, wire_.num_gaussians));
    const std::size_t room = bytes_of(some_more);
    scratch_.carve([&](Carver& c) { take(c, sizes); }, room);
    sizes_ = sizes;
}

std::size_t CudaEngine::bytes_of(const Sizes& sizes) {
    sizes_ = {};  // counting leaves null pointers in the buffers
    Carver count(nullptr);
    take(count, sizes);
    return count.most();
}

void CudaEngine::lay_out_view(const CameraParams<float>& camera, std::int64_t n, bool for_backward) {
    if (std::max(camera.width, camera.height) > kMaxSide)
        throw DeviceError("image of " + std::to_string(camera.width) + "x" + std::to_string(camera.height) +
                          " pixels: the CUDA backend takes up to " + std::to_string(kMaxSide) + " a side");
    begin_lens(camera, n);
    if (lens_shapes_) find_rays(camera);
    if (capacity_ == 0) capacity_ = std::max<std::int64_t>(4 * n, 1 << 16);
    const auto try_capacity = [&] {
        lay_out({for_backward ? Layout::kStep : Layout::kFrame, n, capacity_, camera.width, camera.height, wire_.placed,
                 wire_.splats_from, wire_.sums_from});
    };
    try {
        try_capacity();
    } catch (const DeviceError&) {
        if (needed_ >= capacity_) throw;
        capacity_ = std::max<std::int64_t>(needed_, 1);  // there was no memory for more than is needed
        try_capacity();
    }
}

PreprocessArgs CudaEngine::preprocess_args(const CameraParams<float>& camera, RenderMode mode,
                                           const LazyArgs& lazy) const {
    const auto p = [&](Group g) { return model_.param[int(g)].get(); };
    const ParameterView<float> view{model_.count,
                                    p(Group::kMean),
                                    p(Group::kScale),
                                    p(Group::kRotation),
                                    p(Group::kOpacity),
                                    p(Group::kBase),
                                    p(Group::kResidual),
                                    model_.width[int(Group::kResidual)],
                                    model_.num_residuals(),
                                    meta_.appearance.activation,
                                    model_.shared_param.get(),
                                    model_.smoothing(),
                                    meta_.antialiased};
    return {view,
            camera,
            kernels_.directional ? meta_.active_degree : 0,
            padded(camera.width, kCudaTileX),
            padded(camera.height, kCudaTileY),
            mode,
            DepthKey::of(camera.near_plane, camera.far_plane),
            cutoffs_,
            lazy,
            {},
            {},
            nullptr,
            nullptr,
            nullptr};
}

PreprocessArgs CudaEngine::frame_args(const RenderRequest& r) {
    PreprocessArgs args = preprocess_args(r.camera, r.mode, {});
    if (!options_.half_residuals || model_.floats(int(Group::kResidual)) == 0) return args;
    if (!half_residuals_current_) {
        const std::size_t n = model_.floats(int(Group::kResidual));
        round_to_half<<<num_blocks(n, kBlock), kBlock, 0, stream_>>>(n, model_.param[int(Group::kResidual)].get(),
                                                                     half_residuals_.reserve(n));
        GS_CUDA_LAUNCHED("round_to_half");
        half_residuals_current_ = true;
    }
    args.half_residuals = half_residuals_.get();
    return args;
}

void CudaEngine::begin_lens(const CameraParams<float>& camera, std::int64_t n) {
    lens_shapes_ = nullptr;
    if (camera.lens.is_pinhole()) return;
    lens_shapes_ = lens_shape_room_.reserve(std::size_t(std::max<std::int64_t>(n, 1)));
}

void CudaEngine::find_rays(const CameraParams<float>& camera) {
    if (lens_rays_.get() && has_same_rays(camera_of_rays_, camera)) return;
    const std::size_t pixels = std::size_t(camera.width) * camera.height;
    compute_rays<<<num_blocks(pixels, kBlock), kBlock, 0, stream_>>>(camera, lens_rays_.reserve(pixels));
    GS_CUDA_LAUNCHED("compute_rays");
    camera_of_rays_ = camera;
}

BlendImage CudaEngine::blend_image(const CameraParams<float>& camera, Vec3<float> background) const {
    return {camera.width,
            camera.height,
            background,
            image_,
            transmittance_,
            cutoffs_,
            camera.period(),
            lens_shapes_,
            lens_shapes_ ? lens_rays_.get() : nullptr,
            camera.face_focal(),
            camera.lens.as_pinholes};
}

CudaBins CudaEngine::enqueue_splats(const CameraParams<float>& camera, std::int64_t n, Vec3<float> background,
                                    bool for_backward, const std::function<void()>& fill, std::int64_t most) {
    lay_out_view(camera, n, for_backward);
    largest_width_ = std::max(largest_width_, camera.width), largest_height_ = std::max(largest_height_, camera.height);
    times_.begin(stream_);
    if (n > 0) fill();
    times_.end(CudaStage::kPreprocess, stream_);
    const std::span<uint4> marks = for_backward ? blend_.marks() : std::span<uint4>{};
    const CudaBins bins = binning_.build(splats_, std::min(most, capacity_), marks, control_.get(), stream_);
    times_.end(CudaStage::kSort, stream_);
    blend_.forward(bins, splats_, blend_image(camera, background), control_.get(), for_backward, stream_);
    times_.end(CudaStage::kBlend, stream_);
    return bins;
}

CudaBins CudaEngine::enqueue_forward(PreprocessArgs& args, Vec3<float> background, bool for_backward,
                                     std::int64_t most) {
    const auto complete = [&] {
        args.shared = {model_.shared_prepared.get(), shared_sums_};
        args.separate = separate_;
        args.lens_shapes = lens_shapes_;
    };
    const auto fill = [&] {
        complete();
        kernels_.preprocess(args, splats_, binning_.input(), control_.get(), stream_);
    };
    const CudaBins bins = enqueue_splats(args.camera, model_.count, background, for_backward, fill, most);
    complete();
    return bins;
}

void CudaEngine::make_room(unsigned long long num_instances) {
    GS_CUDA(cudaMemsetAsync(control_.get(), 0, sizeof(StepControl), stream_));
    if (num_instances > kMaxInstances)
        throw DeviceError("more than " + std::to_string(kMaxInstances) + " Gaussian-tile instances in one view (" +
                          std::to_string(num_instances) +
                          "); likely cause: many Gaussians larger than the image. Lower --cap-max, raise --scale-reg "
                          "or render at a lower --resolution");
    needed_ = std::max(needed_, std::int64_t(num_instances));
    // The room may already suffice, if the forecast granted the view less.
    if (std::int64_t(num_instances) > capacity_) capacity_ = room_for(std::int64_t(num_instances));
}

void CudaEngine::forget(const Step& s) {
    if (s.adam_step) lazy_.rewind(--meta_.step);
    ppisp_.rewind(s.isp_step > 0, s.controller_step > 0);
}

void CudaEngine::abandon_steps() {
    cudaStreamSynchronize(stream_);
    wire_.is_updating = false;
    for (const Step& s : in_flight_) forget(s);
    in_flight_.clear();
    cudaMemsetAsync(control_.get(), 0, sizeof(StepControl), stream_);
}

CudaBins CudaEngine::forward_whole(const std::function<CudaBins()>& enqueue) {
    settle();
    const std::int64_t for_steps = capacity_;
    CudaBins bins;
    do {
        if (statuses_->stopped) make_room(statuses_->num_instances);
        bins = enqueue();
        read_status();
    } while (statuses_->stopped);
    // A single close view must not slow down further training. If capacity_ is less than before, that is all that
    // memory allows.
    if (for_steps) capacity_ = std::min(capacity_, for_steps);
    return bins;
}

CudaBins CudaEngine::forward_whole(const RenderRequest& r, bool for_backward) {
    return forward_whole([&] {
        PreprocessArgs args = frame_args(r);
        return enqueue_forward(args, r.background, for_backward);
    });
}

void CudaEngine::report_to(int slot, const CudaLossSums& loss) {
    report_step<<<1, kLossSumThreads, 0, stream_>>>(control_.get(), loss, of_camera_.get(), statuses_ + slot);
    GS_CUDA_LAUNCHED("report_step");
}

const StepStatus& CudaEngine::read_status(const CudaLossSums& loss) {
    report_to(0, loss);
    GS_CUDA(cudaStreamSynchronize(stream_));
    return *statuses_;
}

void CudaEngine::render(const RenderRequest& r, const SplatParts* splats, RenderedImage& out) {
    if (splats)
        forward_whole(*splats, r, false);
    else
        forward_whole(r);
    finish_image(r, out);
}

void CudaEngine::finish_image(const RenderRequest& r, RenderedImage& out) {
    if (r.median) {
        write_medians(binning_.bins(), splats_, blend_image(r.camera, r.background), stream_);
        GS_CUDA(cudaStreamSynchronize(stream_));
    }
    if (r.mode != RenderMode::kResidualOnly && ppisp_.corrects(r.isp)) {  // a residual is not a colour
        ppisp_.apply(r.isp, image_, r.camera.width, r.camera.height, image_, stream_);
        GS_CUDA(cudaStreamSynchronize(stream_));
    }
    const std::size_t pixels = std::size_t(r.camera.width) * r.camera.height;
    out.width = r.camera.width, out.height = r.camera.height;
    out.rgb.resize(3 * pixels), out.alpha.resize(pixels);
    GS_CUDA(cudaMemcpy(out.rgb.data(), image_, 3 * pixels * sizeof(float), cudaMemcpyDeviceToHost));
    GS_CUDA(cudaMemcpy(out.alpha.data(), transmittance_, pixels * sizeof(float), cudaMemcpyDeviceToHost));
    for (float& t : out.alpha) t = 1 - t;
}

std::optional<double> CudaEngine::time_frames(const std::vector<RenderRequest>& views, int repeats) {
    RenderedImage image;
    const std::int64_t for_steps = capacity_;
    std::int64_t most = 1;
    for (const RenderRequest& view : views) {
        render(view, nullptr, image);  // warms up, and finds the room for a view
        most = std::max(most, std::int64_t(statuses_->num_instances));
    }
    capacity_ = most;
    LaunchGraph graph;
    cudaEvent_t begin, end;
    GS_CUDA(cudaEventCreate(&begin));
    GS_CUDA(cudaEventCreate(&end));
    GS_CUDA(cudaEventRecord(begin, stream_));
    for (int k = 0; k < repeats; ++k)
        for (const RenderRequest& view : views) {
            PreprocessArgs args = frame_args(view);
            lay_out_view(view.camera, model_.count, false);
            graph.run(stream_, [&] { enqueue_forward(args, view.background, false); });
            if (ppisp_.corrects(view.isp))
                ppisp_.apply(view.isp, image_, view.camera.width, view.camera.height, image_, stream_);
        }
    GS_CUDA(cudaEventRecord(end, stream_));
    GS_CUDA(cudaEventSynchronize(end));
    float ms = 0;
    GS_CUDA(cudaEventElapsedTime(&ms, begin, end));
    cudaEventDestroy(begin);
    cudaEventDestroy(end);
    capacity_ = for_steps;
    return 1e-3 * ms / (double(repeats) * double(views.size()));
}

// --- steps ----------------------------------------------------------------------------------------------------------

void CudaEngine::step(const StepRequest& r) {
    while (in_flight_.size() >= kInFlight) finish_oldest();
    const bool lazily = r.rates.residuals.empty() && !r.only_visible;
    const bool changes = lazily != lazily_ || r.only_visible != model_.has_last_step;
    if (changes || lazy_.due(meta_.step + 1)) {  // only once no step in flight has to be repeated
        settle();
        lazy_.reset(meta_.step);
    }
    lazily_ = lazily;
    keep_last_steps(r);
    Step s;
    s.request = r;
    s.adam_step = ++meta_.step;
    half_residuals_current_ = false;
    s.lazy = lazy_.begin_step(s.adam_step, lazily, r.rates.groups[int(Group::kResidual)]);
    if (ppisp_.corrects(r.isp) && r.rates.isp > 0) s.isp_step = ppisp_.begin_step();
    launch(std::move(s), r.target);
    if (!times_.pass) return;
    synchronize();
    times_.add();
}

void CudaEngine::distill(const StepRequest& r, const SplatParts* splats) {
    check_distillation(ppisp_.host(), r.isp);
    if (splats) return distill_splats(*splats, r);
    while (in_flight_.size() >= kInFlight) finish_oldest();
    if (in_flight_.empty() || in_flight_.back().adam_step) settle();  // residuals must be up to date
    Step s;
    s.request = r;
    if (r.rates.isp > 0) s.controller_step = ppisp_.begin_controller_step();
    launch(std::move(s), r.target);
}

void CudaEngine::launch(Step s, const TargetImage& target) {
    in_flight_.push_back(std::move(s));
    Step& step = in_flight_.back();
    step.slot = next_slot_;
    step.view = target.id;
    step.request.target = {}, step.request.pixels = nullptr;
    try {
        step.target = images_.get(target, step.slot, stream_);
        enqueue(step);
    } catch (...) {
        forget(step);
        in_flight_.pop_back();
        throw;
    }
    next_slot_ = (next_slot_ + 1) % kInFlight;
}

void CudaEngine::enqueue(const Step& s) {
    lay_out_view(s.request.camera, model_.count, true);
    const ModelArrays arrays = s.adam_step && model_.count > 0 ? arrays_of_step(s.request) : ModelArrays{};
    if (s.request.gather_camera_gradient) {
        camera_sums_.reserve(model_.count, 1);
        of_camera_.reserve(CameraGradient<float>::kSize);
    }
    step_graph_.run(stream_, [&] { enqueue_kernels(s, arrays); });
    GS_CUDA(cudaEventRecord(done_[s.slot], stream_));
}

void CudaEngine::enqueue_kernels(const Step& s, const ModelArrays& arrays) {
    const StepRequest& r = s.request;
    StepControl* control = control_.get();
    PreprocessArgs args = preprocess_args(r.camera, RenderMode::kFull, s.lazy);
    if (r.gather_camera_gradient) args.camera_rows = camera_sums_.rows();
    const CudaBins bins = enqueue_forward(args, r.background, true, forecast_.most(s.view));
    enqueue_loss(r, s.target);
    if (s.isp_step) ppisp_.step_parameters(r.rates.isp, s.isp_step, control, stream_);
    times_.end(CudaStage::kCorrectBackward, stream_);
    if (s.controller_step) ppisp_.step_controller(image_, r.rates.isp, s.controller_step, control, stream_);
    if (s.adam_step) enqueue_gaussians(s, args, bins, arrays);
    report_to(s.slot, loss_.sums());
}

void CudaEngine::enqueue_loss(const StepRequest& r, const DeviceTarget& target) {
    const bool corrected = ppisp_.corrects(r.isp);
    if (corrected) ppisp_.apply(r.isp, image_, r.camera.width, r.camera.height, ppisp_.corrected(), stream_);
    times_.end(CudaStage::kCorrect, stream_);
    loss_.compute({corrected ? ppisp_.corrected() : image_, target.image, r.background, r.loss, target.weight_sum},
                  dL_dimage_, control_.get(), stream_);
    times_.end(CudaStage::kLoss, stream_);
    if (corrected) ppisp_.backward(image_, dL_dimage_, stream_);
}

void CudaEngine::enqueue_sums(const StepRequest& r, std::int64_t n, const CudaBins& bins) {
    const SlotMap slots = binning_.slots();
    const BlendGradients gradients{dL_dimage_, sums_, n, options_.deterministic ? &slots : nullptr};
    blend_.backward(bins, splats_, blend_image(r.camera, r.background), gradients, control_.get(), stream_);
}

void CudaEngine::keep_last_steps(const StepRequest& r) {
    if (r.only_visible && !model_.has_last_step && model_.count > 0) {
        fill_values<<<num_blocks(model_.count, kBlock), kBlock, 0, stream_>>>(
            model_.count, float(meta_.step), model_.last_step.reserve(model_.row_capacity()));
        GS_CUDA_LAUNCHED("fill_values");
    }
    model_.has_last_step = r.only_visible;
}

ModelArrays CudaEngine::arrays_of_step(const StepRequest& r) {
    ModelArrays arrays = model_.arrays();
    if (r.only_visible) arrays.last_step = model_.last_step.get();
    if (!r.gather_gradient_stats) return arrays;
    const std::int64_t n = model_.count;
    if (!model_.has_statistic) {  // this is the first step of a statistic
        GS_CUDA(cudaMemsetAsync(model_.gradient_sum.reserve(n), 0, n * sizeof(float), stream_));
        GS_CUDA(cudaMemsetAsync(model_.gradient_count.reserve(n), 0, n * sizeof(float), stream_));
        model_.has_statistic = true;
    }
    arrays.gradient_sum = model_.gradient_sum.get(), arrays.gradient_count = model_.gradient_count.get();
    return arrays;
}

void CudaEngine::enqueue_gaussians(const Step& s, const PreprocessArgs& args, const CudaBins& bins,
                                   const ModelArrays& arrays) {
    const StepRequest& r = s.request;
    const std::int64_t n = model_.count;
    StepControl* control = control_.get();
    enqueue_sums(r, n, bins);
    times_.end(CudaStage::kBlendBackward, stream_);
    if (n > 0)
        kernels_.update(args, binning_.input().counts, sums_, arrays, update_args(r, s.adam_step, n), control, stream_);
    if (r.gather_camera_gradient) camera_sums_.add_up(n, 1, of_camera_.get(), stream_);
    times_.end(CudaStage::kUpdate, stream_);
}

void CudaEngine::adapt_room(std::int64_t num_instances) {
    needed_ = std::max(needed_, num_instances);
    if (num_instances > capacity_) capacity_ = room_for(num_instances);
    // Allocates room ahead of need.
    if (num_instances > capacity_ / 10 * 9)
        capacity_ = std::min(capacity_ + capacity_ / 4, std::int64_t(kMaxInstances));
    // Gives up room that was not needed for a while: all of the room is sorted in every new view.
    const auto recent = recent_instances_.add(num_instances);
    if (recent && capacity_ > *recent / 2 * 3) capacity_ = room_for(*recent);
}

void CudaEngine::finish_oldest() {
    const Step& s = in_flight_.front();
    GS_CUDA(cudaEventSynchronize(done_[s.slot]));
    const StepStatus status = statuses_[s.slot];
    forecast_.note(s.view, std::int64_t(status.num_instances));
    if (status.stopped) {
        // This step and all after it changed nothing.
        GS_CUDA(cudaStreamSynchronize(stream_));
        try {
            make_room(status.num_instances);
            for (const Step& again : in_flight_) enqueue(again);
        } catch (...) {
            abandon_steps();
            throw;
        }
        return;
    }
    adapt_room(std::int64_t(status.num_instances));
    note_loss(status, s.request.loss, s.target.weight_sum);
    stats_.num_nonfinite_gradients += status.num_nonfinite;
    if (s.request.gather_camera_gradient && std::isfinite(stats_.loss)) {
        CameraGradient<double> gradient{};
        gradient.for_each([&](int k, double& number) { number = status.of_camera[k]; });
        camera_gradients_.push_back({s.view, gradient});
    }
    if (times_.pass)
        times_.count(double(model_.count), status.num_visible,
                     s.request.only_visible ? double(status.num_visible) : double(model_.count),
                     double(status.num_instances), double(status.num_pairs),
                     double(s.request.camera.width) * s.request.camera.height, ppisp_.corrects(s.request.isp));
    in_flight_.pop_front();
}

void CudaEngine::note_loss(const StepStatus& status, const LossWeights& weights, double weight_sum) {
    const ViewLoss loss =
        loss_of_sums(status.l1_sum, status.ssim_sum, weights, weight_sum, std::int64_t(status.num_instances));
    stats_.l1 = loss.l1, stats_.ssim = loss.ssim, stats_.loss = loss.loss;
    stats_.num_instances = loss.num_instances;
    stats_.consecutive_skips = std::isfinite(loss.loss) ? 0 : stats_.consecutive_skips + 1;
    ++stats_.steps;
}

void CudaEngine::synchronize() {
    while (!in_flight_.empty()) finish_oldest();
    statuses_->stopped = 0;
    if (std::exchange(wire_.is_updating, false)) GS_CUDA(cudaStreamSynchronize(stream_));
}

void CudaEngine::settle() {
    synchronize();
    lazy_.catch_up();
}

StepStats CudaEngine::take_stats() {
    StepStats out = stats_;
    stats_.steps = 0;
    stats_.num_nonfinite_gradients = 0;
    // Steps on splats count on the device. The caller reads the counts once the device is idle.
    if (wire_.left_out.get() && !wire_.is_updating) {
        unsigned counts[2];
        device_stream_.copy(counts, wire_.left_out.get(), sizeof counts);
        device_stream_.wait();
        out.num_nonfinite_gradients += counts[0] + counts[1], out.num_nonfinite_common += counts[1];
        GS_CUDA(cudaMemsetAsync(wire_.left_out.get(), 0, sizeof counts, stream_));
    }
    return out;
}

std::vector<ViewCameraGradient> CudaEngine::take_camera_gradients() {
    synchronize();
    collect_camera_gradients();
    return std::exchange(camera_gradients_, {});
}

std::vector<StageCost> CudaEngine::measure_stages(std::optional<int> pass) {
    synchronize();
    const bool continues = std::exchange(times_.pass, pass) && pass && *pass > 0;
    if (continues) return {};
    const ModelInfo& info = appearance_model(meta_.appearance.model);
    // In a mixed model the cost of a residual is averaged over all Gaussians.
    const double share =
        meta_.active_degree > 0 && model_.count > 0 ? double(model_.num_residuals()) / double(model_.count) : 0;
    std::vector<StageCost> costs = times_.take({.width = share * model_.width[int(Group::kResidual)],
                                                .adam_bytes = model_.packed_moments ? 16.0 : 24.0,
                                                .operations = share * info.operations,
                                                .operations_backward = share * info.operations_backward});
    return pass ? std::vector<StageCost>{} : costs;
}

MemoryUse CudaEngine::memory() {
    synchronize();
    MemoryUse use;
    use.bytes = device_memory_count().now, use.peak = device_memory_count().peak;
    use.rows = {{"parameters, Adam moments, indices", model_.bytes() + half_residuals_.bytes() + lazy_.bytes(),
                 "Gaussian", double(model_.count)},
                {"images kept on the device", images_.kept_bytes(), "image", double(images_.num_kept())},
                {"images in flight", images_.slot_bytes(), "image", double(kInFlight)}};
    if (ppisp_.host().active())
        use.rows.push_back({"PPISP", ppisp_.bytes(), "camera", double(ppisp_.host().num_cameras)});
    if (camera_sums_.bytes() > 0)
        use.rows.push_back({"gradients of cameras", camera_sums_.bytes(), "Gaussian", double(model_.count)});
    if (lens_rays_.get())
        use.rows.push_back({"shapes and rays of a lens", lens_shape_room_.bytes() + lens_rays_.bytes(), "Gaussian",
                            double(model_.count)});
    // The next rows split the scratch block of a step by the items with which its parts grow. Stages share memory, so
    // the parts need not add up to the block's size.
    const Sizes all{Layout::kStep, std::max<std::int64_t>(model_.count, 1), std::max<std::int64_t>(capacity_, 1),
                    std::max(largest_width_, 1), std::max(largest_height_, 1)};
    const auto bytes = [&](const Sizes& sizes) { return std::int64_t(bytes_of(sizes)); };
    Sizes no_gaussians = all, no_instances = all, no_pixels = all;
    no_gaussians.n = 0, no_instances.capacity = 1, no_pixels.width = no_pixels.height = 1;
    use.rows.push_back({"scratch with the Gaussians", bytes(all) - bytes(no_gaussians), "Gaussian", double(all.n)});
    use.rows.push_back(
        {"scratch with the instances", bytes(all) - bytes(no_instances), "instance", double(all.capacity)});
    use.rows.push_back(
        {"scratch with the view", bytes(all) - bytes(no_pixels), "pixel", double(all.width) * all.height});
    use.rows.push_back({"scratch block", scratch_.bytes(), "block", 1});
    return use;
}

// --- densification --------------------------------------------------------------------------------------------------

DensifyStats CudaEngine::densify(const DensifyRequest& r) {
    return change_rows([&](CudaDensify& d) {
        if (const auto* mcmc = std::get_if<McmcParams>(&r.rule)) return d.mcmc(*mcmc, r.iteration, meta_.step, r.seed);
        if (const auto* adc = std::get_if<AdcParams>(&r.rule)) return d.adc(*adc, r.iteration, r.seed);
        if (std::holds_alternative<MortonOrder>(r.rule))
            d.morton_sort();
        else
            d.reset_opacity();
        return DensifyStats{.count = model_.count};
    });
}
std::optional<std::vector<float>> CudaEngine::scores(const std::vector<RenderRequest>& views) {
    CudaScores scores(model_.count, stream_);
    for (RenderRequest view : views) {
        view.mode = RenderMode::kFull;
        const CudaBins bins = forward_whole(view);
        const SlotMap slots = binning_.slots();
        scores.add(bins, splats_, blend_image(view.camera, view.background), options_.deterministic ? &slots : nullptr,
                   std::int64_t(statuses_->num_instances));
    }
    return scores.download();
}
TargetImage CudaEngine::enqueue_half_squared_error(const StepRequest& r, double* error) {
    const TargetImage target = images_.get(r.target, 0, stream_).image;
    const bool corrected = ppisp_.corrects(r.isp);
    if (corrected) ppisp_.apply(r.isp, image_, r.camera.width, r.camera.height, ppisp_.corrected(), stream_);
    write_half_squared_error({corrected ? ppisp_.corrected() : image_, target, r.background}, dL_dimage_, error,
                             stream_);
    return target;
}
std::optional<ResidualScores> CudaEngine::residual_scores(std::size_t num_views, const StepSource& step_on) {
    settle();
    const std::int64_t n = model_.count;
    // Borrows memory, so that the selection needs no more memory than training.
    const CudaImages::BorrowedMemory borrowed(images_, CudaResidualScores::bytes(model_.num_residuals()));
    CudaResidualScores scores(model_.num_residuals(), stream_);
    const auto params = [&] { return preprocess_args({}, RenderMode::kFull, {}).params; };
    for (std::size_t view = 0; view < num_views; ++view) {
        const StepRequest r = step_on(view);
        const CudaBins bins = forward_whole({r.camera, r.background, RenderMode::kFull, r.isp}, true);
        const TargetImage target = enqueue_half_squared_error(r, nullptr);
        if (ppisp_.corrects(r.isp)) ppisp_.backward(image_, dL_dimage_, stream_);
        const SlotMap slots = binning_.slots();
        const BlendGradients gradients{dL_dimage_, sums_, n, options_.deterministic ? &slots : nullptr};
        const auto backward = [&] {
            blend_.backward(bins, splats_, blend_image(r.camera, r.background), gradients, control_.get(), stream_);
        };
        backward();
        scores.keep_gradients(binning_.input().counts, sums_);
        blend_.begin_again(stream_);
        write_mask_weights(target, dL_dimage_, stream_);
        backward();
        scores.add(params(), binning_.input().counts, splats_, sums_);
        GS_CUDA(cudaStreamSynchronize(stream_));  // the next image may reuse this memory
    }
    return residual_scores_of(scores.download(), meta_.appearance.activation,
                              download(Download::kBases)[Group::kBase].param);
}
void CudaEngine::keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) {
    settle();
    sizes_ = {};  // moving rows may use all of the scratch block
    half_residuals_current_ = false;
    DeviceBuffer<unsigned char> device_marks;
    DeviceBuffer<float> device_bases;
    device_marks.upload(marks), device_bases.upload(bases);
    GS_CUDA(cudaDeviceSynchronize());  // the copies are not on the stream that reads them
    scratch_.release();                // its memory is needed while rows are copied
    CudaResidualHandles residuals(model_, stream_, true);
    residuals.keep(device_marks.get(), device_bases.get());
    residuals.resolve(scratch_);
    lazy_.reset(meta_.step);
}
PruneStats CudaEngine::prune(const PruneRequest& request) {
    PruneStats stats;
    if (std::holds_alternative<NonFiniteRows>(request)) {
        stats.removed = change_rows([&](CudaDensify& d) { return d.prune_nonfinite(stats.by_group.data()); });
    } else if (const auto* but = std::get_if<AllBut>(&request)) {
        stats.removed = model_.count - std::int64_t(but->rows.size());
        change_rows([&](CudaDensify& d) { return d.keep_rows(but->rows), 0; });
    } else {
        stats.removed = change_rows([](CudaDensify& d) { return d.prune_invisible(); });
        // No new Gaussians will replace them.
        scratch_.release();
        model_.shrink_rows();
    }
    return stats;
}

std::unique_ptr<Engine> make_cuda_engine(const ModelKernels& kernels, const EngineOptions& options) {
    return std::make_unique<CudaEngine>(kernels, options);
}

}  // namespace gs
