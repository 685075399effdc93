// SPDX-License-Identifier: Apache-2.0
// PPISP on the device. The forward and backward pass each visit a view's pixels once; one block computes the 37 sums
// and the few parameters.
#include "kernels/ppisp/ppisp_cuda.h"
#include "kernels/state/adam_device.h"

namespace gs {
namespace {

constexpr int kPixelThreads = 256;
/// Block size and number of blocks of the backward pass. Each block first adds up its pixels in registers, so that the
/// sums over blocks are short. The number of blocks is four times the multiprocessors of a large device. It is fixed,
/// so that results do not depend on the device.
constexpr int kSumThreads = 128, kSumBlocks = 528;
/// Threads of the one block that takes the optimizer's step, which has only a few values per frame.
constexpr int kStepThreads = 1024;

__device__ Vec3<float> pixel_of(const float* image, std::size_t i, std::size_t pixels) {
    return {image[i], image[pixels + i], image[2 * pixels + i]};
}
__device__ void put_pixel(float* image, std::size_t i, std::size_t pixels, const Vec3<float>& c) {
    image[i] = c.x, image[pixels + i] = c.y, image[2 * pixels + i] = c.z;
}

/// Returns isp_uv of pixel i. Images have fewer than 2^32 pixels (largest side 65504), and 32-bit division is cheaper.
__device__ Vec2<float> uv_of(std::size_t i, int width, int height) {
    return isp_uv<float>(int(unsigned(i) % unsigned(width)), int(unsigned(i) / unsigned(width)), width, height);
}

/// Prepares a view. A null raw_frame means neutral values.
__global__ void prepare_view(const float* raw_frame, const float* raw_camera, IspDeviceView* view) {
    const int k = threadIdx.x;
    if (k < kIspFrameValues) view->raw_frame[k] = raw_frame ? raw_frame[k] : 0.0f;
    if (k < kIspCameraValues) view->raw_camera[k] = raw_camera[k];
    __syncwarp();
    if (k == 0) view->frame = isp_frame(view->raw_frame);
    if (k == 1) view->camera = isp_camera(view->raw_camera);
}

__global__ void __launch_bounds__(kPixelThreads)
    correct(const IspDeviceView* view, const float* image, int width, int height, float* out) {
    const std::size_t pixels = std::size_t(width) * height, i = std::size_t(blockIdx.x) * kPixelThreads + threadIdx.x;
    if (i >= pixels) return;
    put_pixel(out, i, pixels,
              isp_forward(view->frame, view->camera, pixel_of(image, i, pixels), uv_of(i, width, height)));
}

__global__ void __launch_bounds__(kSumThreads)
    correct_backward(const IspDeviceView* view, const float* image, float* dL_dimage, int width, int height,
                     float* partials) {
    const std::size_t pixels = std::size_t(width) * height;
    const IspFrame<float> frame = view->frame;
    IspSums<float> sums{};
    for (std::size_t i = std::size_t(blockIdx.x) * kSumThreads + threadIdx.x; i < pixels;
         i += std::size_t(kSumBlocks) * kSumThreads)
        put_pixel(dL_dimage, i, pixels,
                  isp_backward(frame, view->camera, pixel_of(image, i, pixels), uv_of(i, width, height),
                               pixel_of(dL_dimage, i, pixels), sums));
    __shared__ float of_warps[kSumThreads / 32][kIspSums];
#pragma unroll
    for (int k = 0; k < kIspSums; ++k) {
        const float sum = warp_sum(sums.v[k]);
        if (threadIdx.x % 32 == 0) of_warps[threadIdx.x / 32][k] = sum;
    }
    __syncthreads();
    if (threadIdx.x >= kIspSums) return;
    float sum = 0;
    for (int w = 0; w < kSumThreads / 32; ++w) sum += of_warps[w][threadIdx.x];
    partials[blockIdx.x * kIspSums + threadIdx.x] = sum;
}

/// Adds up the partial sums and finishes the view's gradients. Each sum is computed by one warp, in double as on the
/// CPU.
__global__ void __launch_bounds__(kStepThreads) finish_view(const float* partials, IspDeviceView* view) {
    __shared__ IspSums<float> sums;
    const int lane = threadIdx.x % 32;
    for (int k = threadIdx.x / 32; k < kIspSums; k += kStepThreads / 32) {
        double sum = 0;
        for (int b = lane; b < kSumBlocks; b += 32) sum += partials[b * kIspSums + k];
        sum = warp_sum(sum);
        if (lane == 0) sums.v[k] = float(sum);
    }
    __syncthreads();
    if (threadIdx.x == 0) isp_finish(view->raw_frame, view->raw_camera, sums, view->dL_dframe, view->dL_dcamera);
}

struct StepArgs {
    float *param, *m, *v, *gradient;
    int frames, cameras, frame, camera;  ///< counts of both, and the view's indices; frame -1: none
    AdamStep<float> step;
};

__global__ void __launch_bounds__(kStepThreads)
    step_parameters_of_all(StepArgs a, const IspDeviceView* view, StepControl* control) {
    if (control->takes_no_step()) return;
    constexpr int kSummands = kStepThreads / kIspFrameValues;
    __shared__ double summands[kSummands][kIspFrameValues], means[kIspFrameValues], regularizer[kIspFrameValues];
    const int t = threadIdx.x, of_frames = a.frames * kIspFrameValues, all = of_frames + a.cameras * kIspCameraValues;
    if (t < kSummands * kIspFrameValues) {
        double sum = 0;
        for (int i = t; i < of_frames; i += kSummands * kIspFrameValues) sum += a.param[i];
        summands[t / kIspFrameValues][t % kIspFrameValues] = sum;
    }
    __syncthreads();
    if (t < kIspFrameValues) {
        double sum = 0;
        for (int k = 0; k < kSummands; ++k) sum += summands[k][t];
        means[t] = a.frames > 0 ? sum / a.frames : 0;
    }
    __syncthreads();
    if (t == 0) isp_frame_regularizer(means, a.frames > 1 ? a.frames : 1, regularizer);
    __syncthreads();
    bool finite = true;
    for (int i = t; i < all; i += kStepThreads) {
        float g;
        if (i < of_frames) {
            g = float(regularizer[i % kIspFrameValues]);
            if (i / kIspFrameValues == a.frame) g += view->dL_dframe[i % kIspFrameValues];
        } else {
            const int camera = (i - of_frames) / kIspCameraValues, k = (i - of_frames) % kIspCameraValues;
            g = isp_camera_regularizer(a.param + of_frames + camera * kIspCameraValues, a.cameras, k);
            if (camera == a.camera) g += view->dL_dcamera[k];
        }
        finite &= gs_isfinite(g);
        a.gradient[i] = g;  // parameters must not change before all gradients have read them
    }
    if (!__syncthreads_and(finite)) {
        if (t == 0) atomicAdd(&control->num_nonfinite, 1u);
        return;
    }
    for (int i = t; i < all; i += kStepThreads) adam_update(a.param[i], a.m[i], a.v[i], a.gradient[i], a.step);
}

}  // namespace

void CudaPpisp::upload(const PpispState& state) {
    host_ = state;
    drop_moments(host_);
    if (!state.active()) return;
    param_.upload(state.param);
    m_.upload_or_zero(state.m, state.size());
    v_.upload_or_zero(state.v, state.size());
    gradient_.reserve(state.size());
    device_view_.reserve(1);
    controller_.upload(state);
}

PpispState CudaPpisp::download(bool with_moments) const {
    PpispState state = host_;
    if (!state.active()) return state;
    state.param = param_.download(state.size());
    if (with_moments) state.m = m_.download(state.size()), state.v = v_.download(state.size());
    controller_.download(state, with_moments);
    return state;
}

void CudaPpisp::take(Carver& c, int width, int height, bool for_step) {
    if (!host_.active()) return;
    if (for_step) {
        corrected_ = c.take<float>(3 * std::size_t(width) * height);
        partials_ = c.take<float>(kSumBlocks * kIspSums);
    }
    controller_.take(c, width, height, for_step);
}

void CudaPpisp::apply(const IspView& view, const float* image, int width, int height, float* out, cudaStream_t stream) {
    check_isp_view(host_, view);
    view_ = view, width_ = width, height_ = height;
    const float* frame = nullptr;
    if (view.mode == IspMode::kFrame && view.frame >= 0)
        frame = param_.get() + std::size_t(view.frame) * kIspFrameValues;
    if (view.mode == IspMode::kController && controller_.exists())
        frame = controller_.forward(view.camera, {image, width, height}, view.prior_exposure, stream);
    prepare_view<<<1, 32, 0, stream>>>(frame, param_.get() + host_.camera_offset(view.camera), device_view_.get());
    GS_CUDA_LAUNCHED("prepare_view");
    correct<<<num_blocks(std::int64_t(width) * height, kPixelThreads), kPixelThreads, 0, stream>>>(
        device_view_.get(), image, width, height, out);
    GS_CUDA_LAUNCHED("correct");
}

void CudaPpisp::backward(const float* image, float* dL_dimage, cudaStream_t stream) {
    correct_backward<<<kSumBlocks, kSumThreads, 0, stream>>>(device_view_.get(), image, dL_dimage, width_, height_,
                                                             partials_);
    GS_CUDA_LAUNCHED("correct_backward");
    finish_view<<<1, kStepThreads, 0, stream>>>(partials_, device_view_.get());
    GS_CUDA_LAUNCHED("finish_view");
}

void CudaPpisp::step_parameters(double rate, std::int64_t step, StepControl* control, cudaStream_t stream) {
    const StepArgs args{param_.get(),
                        m_.get(),
                        v_.get(),
                        gradient_.get(),
                        host_.num_frames,
                        host_.num_cameras,
                        view_.mode == IspMode::kFrame ? view_.frame : -1,
                        view_.camera,
                        AdamStep<float>::at(rate, step)};
    step_parameters_of_all<<<1, kStepThreads, 0, stream>>>(args, device_view_.get(), control);
    GS_CUDA_LAUNCHED("step_parameters_of_all");
}

void CudaPpisp::add_gradient(std::vector<float>& gradient, cudaStream_t stream) const {
    GS_CUDA(cudaStreamSynchronize(stream));
    const IspDeviceView view = device_view_.download(1)[0];
    add_isp_gradient(host_, view_, view.dL_dframe, view.dL_dcamera, gradient);
}

void CudaPpisp::step_controller(const float* image, double rate, std::int64_t step, StepControl* control,
                                cudaStream_t stream) {
    if (controller_sees(width_, height_))
        controller_.step(view_.camera, {image, width_, height_}, device_view_.get()->dL_dframe, rate, step, control,
                         stream);
}

std::int64_t CudaPpisp::bytes() const {
    return param_.bytes() + m_.bytes() + v_.bytes() + gradient_.bytes() + device_view_.bytes() + controller_.bytes();
}

}  // namespace gs
