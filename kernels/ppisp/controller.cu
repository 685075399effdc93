// SPDX-License-Identifier: Apache-2.0
// The controller on the device. One block of threads processes each row of 3x3-pixel blocks, and the row sums are added
// in order. A single block computes the layers after the mean.
#include "kernels/ppisp/ppisp_cuda.h"
#include "kernels/state/adam_device.h"

namespace gs {
namespace {

using Activations = ControllerActivations;

constexpr int kRowValues = kControllerBins * kControllerChannels;
/// Number of columns that a block processes together.
constexpr int kForwardColumns = 128, kForwardThreads = kRowValues, kBackwardColumns = 64, kBackwardThreads = 256;
static_assert(kForwardThreads >= kForwardColumns && kBackwardThreads >= kBackwardColumns);
constexpr int kDenseThreads = 1024, kWeightThreads = 256;

__device__ void copy_block_weights(const float* weights, float* to) {
    for (int k = threadIdx.x; k < kControllerBlockWeights; k += blockDim.x) to[k] = weights[k];
}

/// Sums the features of one row of blocks by bin: (rows, 5, 32).
__global__ void __launch_bounds__(kForwardThreads)
    sum_row_features(const float* weights, const float* image, int width, int height, float* row_sums) {
    __shared__ float w[kControllerBlockWeights], features[kForwardColumns][kControllerChannels + 1];
    copy_block_weights(weights, w);
    const int t = threadIdx.x, columns = controller_blocks(width), bin = t / kControllerChannels,
              channel = t % kControllerChannels;
    const int begin = controller_bin_begin(bin, columns), end = controller_bin_end(bin, columns);
    float sum = 0;
    for (int first = 0; first < columns; first += kForwardColumns) {
        __syncthreads();
        if (t < kForwardColumns && first + t < columns) {
            ControllerFeatures<float> f;
            controller_features(w, controller_block(image, width, height, first + t, int(blockIdx.x)), f);
#pragma unroll
            for (int c = 0; c < kControllerChannels; ++c) features[t][c] = f.out[c];
        }
        __syncthreads();
        for (int x = max(first, begin); x < min(first + kForwardColumns, end); ++x) sum += features[x - first][channel];
    }
    row_sums[blockIdx.x * kRowValues + t] = sum;
}

/// Computes out = W in + b with one warp per output.
__device__ void linear(const float* weights, ControllerLayer layer, const float* in, float* out, bool relu) {
    const int lane = threadIdx.x % 32;
    for (int o = threadIdx.x / 32; o < layer.outputs; o += kDenseThreads / 32) {
        float sum = 0;
        for (int i = lane; i < layer.inputs; i += 32) sum += weights[layer.offset + o * layer.inputs + i] * in[i];
        sum = warp_sum(sum) + weights[layer.bias() + o];
        if (lane == 0) out[o] = relu ? fmaxf(sum, 0.0f) : sum;
    }
    __syncthreads();
}

__global__ void __launch_bounds__(kDenseThreads)
    evaluate_dense(const float* weights, const float* row_sums, int columns, int rows, float prior_exposure,
                   Activations* a) {
    for (int k = threadIdx.x; k < Activations::kGridValues; k += kDenseThreads) {
        const int bin = k / kControllerChannels,
                  at = bin % kControllerBins * kControllerChannels + k % kControllerChannels, y = bin / kControllerBins;
        float sum = 0;
        for (int row = controller_bin_begin(y, rows); row < controller_bin_end(y, rows); ++row)
            sum += row_sums[row * kRowValues + at];
        a->bins[k] = sum / controller_bin_size(bin, columns, rows);
    }
    __syncthreads();
    constexpr ControllerLayer encoder = controller_layer(2);
    for (int k = threadIdx.x; k < Activations::kEncoded; k += kDenseThreads) {
        const int e = k / kControllerGrid, bin = k % kControllerGrid;
        float sum = weights[encoder.bias() + e];
        for (int c = 0; c < encoder.inputs; ++c)
            sum += weights[encoder.offset + e * encoder.inputs + c] * a->bins[bin * kControllerChannels + c];
        a->inputs[k] = sum;
    }
    if (threadIdx.x == 0) a->inputs[Activations::kEncoded] = prior_exposure;
    __syncthreads();
    linear(weights, controller_layer(3), a->inputs, a->hidden[0], true);
    linear(weights, controller_layer(4), a->hidden[0], a->hidden[1], true);
    linear(weights, controller_layer(5), a->hidden[1], a->hidden[2], true);
    linear(weights, controller_layer(6), a->hidden[2], a->out, false);
}

/// Returns W^T dL_dout for input i.
__device__ float linear_backward(const float* weights, ControllerLayer layer, const float* dL_dout, int i) {
    float sum = 0;
    for (int o = 0; o < layer.outputs; ++o) sum += weights[layer.offset + o * layer.inputs + i] * dL_dout[o];
    return sum;
}

__global__ void __launch_bounds__(kDenseThreads)
    dense_backward(const float* weights, const float* dL_dout, int columns, int rows, Activations* a) {
    const int t = threadIdx.x;
    if (t < kIspFrameValues) a->dL_dout[t] = dL_dout[t];
    if (t == 0) a->nonfinite = 0;
    __syncthreads();
    const float* d = a->dL_dout;
    for (int k = 2; k >= 0; --k) {
        if (t < kControllerHidden)
            a->dL_dhidden[k][t] = a->hidden[k][t] > 0 ? linear_backward(weights, controller_layer(4 + k), d, t) : 0.0f;
        d = a->dL_dhidden[k];
        __syncthreads();
    }
    for (int i = t; i < Activations::kEncoded; i += kDenseThreads)
        a->dL_dencoded[i] = linear_backward(weights, controller_layer(3), d, i);
    __syncthreads();
    constexpr ControllerLayer encoder = controller_layer(2);
    for (int k = t; k < Activations::kGridValues; k += kDenseThreads) {
        const int bin = k / kControllerChannels, c = k % kControllerChannels;
        float sum = 0;
        for (int e = 0; e < encoder.outputs; ++e)
            sum += weights[encoder.offset + e * encoder.inputs + c] * a->dL_dencoded[e * kControllerGrid + bin];
        a->dL_dbins[k] = sum / controller_bin_size(bin, columns, rows);
    }
}

/// Sums the gradients of the block layers over one row of blocks: (rows, kControllerBlockWeights).
__global__ void __launch_bounds__(kBackwardThreads)
    sum_row_gradients(const float* weights, const float* image, int width, int height, const Activations* a,
                      float* row_gradients) {
    constexpr ControllerLayer first = controller_layer(0), second = controller_layer(1);
    __shared__ float w[kControllerBlockWeights], dL_dcolumn[kControllerBins][kControllerChannels];
    __shared__ float hidden[kBackwardColumns][kControllerHiddenChannels],
        dL_dhidden[kBackwardColumns][kControllerHiddenChannels];
    __shared__ float dL_dout[kBackwardColumns][kControllerChannels],
        pixel[kBackwardColumns][kControllerHiddenChannels * 3];
    copy_block_weights(weights, w);
    const int t = threadIdx.x, y = blockIdx.x, columns = controller_blocks(width), rows = controller_blocks(height);
    if (t < kRowValues) {  // the gradient of a block of this row from each bin column
        float sum = 0;
        for (int row = 0; row < kControllerBins; ++row)
            if (controller_bin_has(row, rows, y)) sum += a->dL_dbins[row * kRowValues + t];
        dL_dcolumn[t / kControllerChannels][t % kControllerChannels] = sum;
    }
    constexpr int kMine = (kControllerBlockWeights + kBackwardThreads - 1) / kBackwardThreads;
    float sums[kMine] = {};
    for (int begin = 0; begin < columns; begin += kBackwardColumns) {
        __syncthreads();
        const int x = begin + t;
        if (t < kBackwardColumns && x < columns) {
            const ControllerBlock<float> block = controller_block(image, width, height, x, y);
            ControllerFeatures<float> f;
            controller_features(w, block, f);
            for (int c = 0; c < kControllerChannels; ++c) {
                float g = 0;
                for (int bin = 0; bin < kControllerBins; ++bin)
                    if (controller_bin_has(bin, columns, x)) g += dL_dcolumn[bin][c];
                dL_dout[t][c] = f.out[c] > 0 ? g : 0.0f;
            }
            for (int k = 0; k < kControllerHiddenChannels; ++k) {
                float g = 0;
                for (int c = 0; c < kControllerChannels; ++c)
                    g += dL_dout[t][c] * w[second.offset + c * second.inputs + k];
                hidden[t][k] = f.hidden[k];
                dL_dhidden[t][k] = f.hidden[k] > 0 ? g : 0.0f;
                for (int channel = 0; channel < 3; ++channel) pixel[t][3 * k + channel] = block.at(channel, f.pixel[k]);
            }
        }
        __syncthreads();
        const int here = min(kBackwardColumns, columns - begin);
        for (int m = 0; m < kMine; ++m) {
            const int k = t + m * kBackwardThreads;
            for (int j = 0; j < here; ++j) {
                if (k < first.bias())
                    sums[m] += dL_dhidden[j][k / 3] * pixel[j][k];
                else if (k < second.offset)
                    sums[m] += dL_dhidden[j][k - first.bias()];
                else if (k < second.bias())
                    sums[m] += dL_dout[j][(k - second.offset) / second.inputs] *
                               hidden[j][(k - second.offset) % second.inputs];
                else if (k < kControllerBlockWeights)
                    sums[m] += dL_dout[j][k - second.bias()];
            }
        }
    }
    for (int m = 0; m < kMine; ++m)
        if (const int k = t + m * kBackwardThreads; k < kControllerBlockWeights)
            row_gradients[std::size_t(y) * kControllerBlockWeights + k] = sums[m];
}

/// Returns the gradient of weight k from the layers' activations and gradients.
__device__ float weight_gradient(int k, const Activations* a, const float* row_gradients, int rows) {
    if (k < kControllerBlockWeights) {
        double sum = 0;
        for (int y = 0; y < rows; ++y) sum += row_gradients[std::size_t(y) * kControllerBlockWeights + k];
        return float(sum);
    }
    if (k < controller_layer(3).offset) {
        constexpr ControllerLayer encoder = controller_layer(2);
        const bool bias = k >= encoder.bias();
        const int e = bias ? k - encoder.bias() : (k - encoder.offset) / encoder.inputs,
                  c = (k - encoder.offset) % encoder.inputs;
        float sum = 0;
        for (int bin = 0; bin < kControllerGrid; ++bin)
            sum += a->dL_dencoded[e * kControllerGrid + bin] * (bias ? 1.0f : a->bins[bin * kControllerChannels + c]);
        return sum;
    }
    const int number = k < controller_layer(4).offset   ? 3
                       : k < controller_layer(5).offset ? 4
                       : k < controller_layer(6).offset ? 5
                                                        : 6;
    const ControllerLayer layer = controller_layer(number);
    const float *in = number == 3 ? a->inputs : a->hidden[number - 4],
                *d = number == 6 ? a->dL_dout : a->dL_dhidden[number - 3];
    return k >= layer.bias() ? d[k - layer.bias()]
                             : d[(k - layer.offset) / layer.inputs] * in[(k - layer.offset) % layer.inputs];
}

__global__ void __launch_bounds__(kWeightThreads)
    weight_gradients(Activations* a, const float* row_gradients, int rows, float* gradient) {
    const int k = blockIdx.x * kWeightThreads + threadIdx.x;
    if (k >= kControllerWeights) return;
    const float g = weight_gradient(k, a, row_gradients, rows);
    gradient[k] = g;
    if (!gs_isfinite(g)) a->nonfinite = 1;
}

__global__ void __launch_bounds__(kWeightThreads)
    step_weights(const Activations* a, const float* gradient, float* weights, float* m, float* v, AdamStep<float> step,
                 StepControl* control) {
    if (control->takes_no_step()) return;
    const int k = blockIdx.x * kWeightThreads + threadIdx.x;
    if (a->nonfinite) {
        if (k == 0) atomicAdd(&control->num_nonfinite, 1u);
        return;
    }
    if (k < kControllerWeights) adam_update(weights[k], m[k], v[k], gradient[k], step);
}

}  // namespace

void CudaController::upload(const PpispState& state) {
    count_ = state.controller.empty() ? 0 : state.num_cameras;
    if (count_ == 0) return;
    const std::size_t n = state.controller.size();
    weights_.upload(state.controller);
    m_.upload_or_zero(state.controller_m, n);
    v_.upload_or_zero(state.controller_v, n);
    activations_.reserve(1);
}

void CudaController::download(PpispState& state, bool with_moments) const {
    if (count_ == 0) return;
    const std::size_t n = std::size_t(count_) * kControllerWeights;
    state.controller = weights_.download(n);
    if (with_moments) state.controller_m = m_.download(n), state.controller_v = v_.download(n);
}

void CudaController::take(Carver& c, int width, int height, bool for_step) {
    if (count_ == 0 || !controller_sees(width, height)) return;
    const std::size_t rows = std::size_t(controller_blocks(height));
    row_sums_ = c.take<float>(rows * kRowValues);
    if (!for_step) return;
    row_gradients_ = c.take<float>(rows * kControllerBlockWeights);
    gradient_ = c.take<float>(kControllerWeights);
}

const float* CudaController::forward(int camera, const ControllerImage& image, float prior_exposure,
                                     cudaStream_t stream) {
    const auto [rgb, width, height] = image;
    Activations* a = activations_.get();
    if (!controller_sees(width, height)) {
        GS_CUDA(cudaMemsetAsync(a->out, 0, sizeof a->out, stream));
        return a->out;
    }
    const float* weights = weights_.get() + std::size_t(camera) * kControllerWeights;
    sum_row_features<<<controller_blocks(height), kForwardThreads, 0, stream>>>(weights, rgb, width, height, row_sums_);
    GS_CUDA_LAUNCHED("sum_row_features");
    evaluate_dense<<<1, kDenseThreads, 0, stream>>>(weights, row_sums_, controller_blocks(width),
                                                    controller_blocks(height), prior_exposure, a);
    GS_CUDA_LAUNCHED("evaluate_dense");
    return a->out;
}

void CudaController::step(int camera, const ControllerImage& image, const float* dL_dout, double rate,
                          std::int64_t step, StepControl* control, cudaStream_t stream) {
    const auto [rgb, width, height] = image;
    const std::size_t at = std::size_t(camera) * kControllerWeights;
    const int columns = controller_blocks(width), rows = controller_blocks(height);
    float* weights = weights_.get() + at;
    Activations* a = activations_.get();
    dense_backward<<<1, kDenseThreads, 0, stream>>>(weights, dL_dout, columns, rows, a);
    GS_CUDA_LAUNCHED("dense_backward");
    sum_row_gradients<<<rows, kBackwardThreads, 0, stream>>>(weights, rgb, width, height, a, row_gradients_);
    GS_CUDA_LAUNCHED("sum_row_gradients");
    const unsigned blocks = num_blocks(kControllerWeights, kWeightThreads);
    weight_gradients<<<blocks, kWeightThreads, 0, stream>>>(a, row_gradients_, rows, gradient_);
    GS_CUDA_LAUNCHED("weight_gradients");
    step_weights<<<blocks, kWeightThreads, 0, stream>>>(a, gradient_, weights, m_.get() + at, v_.get() + at,
                                                        AdamStep<float>::at(rate, step), control);
    GS_CUDA_LAUNCHED("step_weights");
}

std::int64_t CudaController::bytes() const { return weights_.bytes() + m_.bytes() + v_.bytes() + activations_.bytes(); }

}  // namespace gs
