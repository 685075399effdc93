// SPDX-License-Identifier: Apache-2.0
// Evaluates the network for 32 Gaussians at a time on the tensor cores.
//
// Operands are halves and sums are float. Activations go from one layer to the next in registers. Only the inputs and
// the three outputs pass through shared memory, from and to the lane of their Gaussian. The backward pass evaluates the
// network again instead of storing activations: 7 more products for 16 Gaussians, instead of 134 stored bytes per
// Gaussian.
//
// Gradients can be as small as 1e-10, because a loss is a mean over pixels. Each warp multiplies its gradients by the
// power of two that takes the largest to [32, 64), and its contributions to the sums of the weights, in float, by the
// inverse. So neither subnormals nor overflow of half occur, and no scale has to be tuned per scene.
#pragma once

#include <cuda_fp16.h>

#include "appearance/neural/neural.h"
#include "appearance/warp_appearance_cuda.cuh"

namespace gs::tensor {

// Multiplies small half-precision matrices on the tensor cores of one warp: C (16x8, float) += A (16x16) B (16x8).
//
// The elements are distributed as follows (PTX ISA, mma.m16n8k16), with group = lane / 4, pair = 2 * (lane % 4):
//   A: registers 0 to 3 hold columns pair, pair + 1 of row group, of row group + 8, and the same for columns from 8 on;
//   B: registers 0 and 1 hold rows pair, pair + 1 of column group, and the same for rows from 8 on;
//   C: values 0, 1 are columns pair, pair + 1 of row group, 2, 3 of row group + 8.
// So two neighbouring C tiles, rounded, are the A operand of the next product.

/// The magnitude at which values saturate on conversion to half. The largest half is 65504.
inline constexpr float kSaturation = 60000.0f;

/// Adds A B to C.
__device__ inline void multiply(float (&c)[4], const unsigned (&a)[4], unsigned b0, unsigned b1) {
    asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
        : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
        : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}

/// Returns two values as halves, `low` in the lower bits. Values beyond the range of half saturate.
__device__ inline unsigned pack(float low, float high) {
    const __half2 h =
        __floats2half2_rn(fminf(fmaxf(low, -kSaturation), kSaturation), fminf(fmaxf(high, -kSaturation), kSaturation));
    return *reinterpret_cast<const unsigned*>(&h);
}
__device__ inline float2 unpack(unsigned x) { return __half22float2(*reinterpret_cast<const __half2*>(&x)); }

/// Loads a 16x16 piece of a row-major matrix in shared memory as A; `stride` is in halves and a multiple of 8.
__device__ inline void load(unsigned (&r)[4], const __half* piece, int stride) {
    const int lane = threadIdx.x & 31;
    const unsigned at = unsigned(__cvta_generic_to_shared(piece + (lane & 15) * stride + (lane >> 4) * 8));
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(r[0]), "=r"(r[1]), "=r"(r[2]), "=r"(r[3])
                 : "r"(at)
                 : "memory");
}
/// Loads a 16x16 piece as two B operands: its columns 0 to 7 (registers 0, 1) and 8 to 15 (2, 3).
__device__ inline void load_columns(unsigned (&r)[4], const __half* piece, int stride) {
    const int lane = threadIdx.x & 31;
    const unsigned at = unsigned(__cvta_generic_to_shared(piece + (lane & 15) * stride + (lane >> 4) * 8));
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(r[0]), "=r"(r[1]), "=r"(r[2]), "=r"(r[3])
                 : "r"(at)
                 : "memory");
}
/// Loads a 16x8 piece as registers 0 and 1 of A.
__device__ inline void load_half(unsigned& r0, unsigned& r1, const __half* piece, int stride) {
    const int lane = threadIdx.x & 31;
    const unsigned at = unsigned(__cvta_generic_to_shared(piece + (lane & 15) * stride));
    asm volatile("ldmatrix.sync.aligned.m8n8.x2.shared.b16 {%0,%1}, [%2];" : "=r"(r0), "=r"(r1) : "r"(at) : "memory");
}

/// Returns the transpose of an 8x8 tile of halves.
__device__ inline unsigned transpose(unsigned x) {
    unsigned y;
    asm("movmatrix.sync.aligned.m8n8.trans.b16 %0, %1;" : "=r"(y) : "r"(x));
    return y;
}

}  // namespace gs::tensor

namespace gs {

template <int kFeatures, int kFrequencies, int kLayers, int kNeurons>
class WarpAppearance<appearance::NeuralResidual<kFeatures, kFrequencies, kLayers, kNeurons>> {
    using Model = appearance::NeuralResidual<kFeatures, kFrequencies, kLayers, kNeurons>;
    static constexpr int kInputs = Model::kInputs, kEncoded = Model::kEncoded;
    static constexpr int kInTiles = kInputs / 16, kInColumns = kInputs / 8, kTiles = kNeurons / 16,
                         kColumns = kNeurons / 8;
    static_assert(kInputs % 16 == 0 && kEncoded % 8 == 0 && kNeurons % 16 == 0, "matrices of whole tiles");
    static_assert(kFrequencies <= 1, "a feature's gradient comes from one pair of inputs");
    static_assert(kInputs >= 2 * Model::kBases, "the gradient of the bases takes the place of the inputs");
    /// Length of one Gaussian's row in halves: its inputs, and 16 bytes for its outputs or their gradient. Rows of this
    /// length avoid bank conflicts.
    static constexpr int kStride = kInputs + 8;

    // The fragments of B operands hold the matrices of the forward pass, then the transposes for the backward pass.
    static constexpr int forward_matrix(int layer) {
        return layer == 0 ? 0 : kInTiles * kColumns + (layer - 1) * kTiles * kColumns;
    }
    static constexpr int kForwardOutput = forward_matrix(kLayers);
    static constexpr int kBackwardOutput = kForwardOutput + kTiles;
    static constexpr int backward_matrix(int layer) {
        return kBackwardOutput + kColumns +
               (layer == 0 ? (kLayers - 1) * kTiles * kColumns : (layer - 1) * kTiles * kColumns);
    }
    static constexpr int kFragments = backward_matrix(0) + kTiles * kInColumns;

  public:
    struct Memory {
        alignas(16) __half stage[32 * kStride];
    };
    static constexpr int kPreparedWords = kFragments * 64;

    __device__ WarpAppearance(Memory& memory, const unsigned* prepared)
        : stage_(memory.stage), fragments_(reinterpret_cast<const uint2*>(prepared) + lane()) {}

    __device__ Vec3<float> residual(const float* rows, int width, const Vec3<float>& direction, int degree,
                                    bool active) {
        stage_inputs(rows + lane() * width, direction, degree, active);
#pragma unroll
        for (int tile = 0; tile < 2; ++tile) {
            unsigned in[kInTiles][4];
#pragma unroll
            for (int k = 0; k < kInTiles; ++k) tensor::load(in[k], inputs(tile) + 16 * k, kStride);
#pragma unroll
            for (int layer = 0; layer < kLayers; ++layer)
#pragma unroll
                for (int n = 0; n < kColumns; ++n) {
                    float c[4] = {};
                    if (layer == 0) {
#pragma unroll
                        for (int k = 0; k < kInTiles; ++k) multiply(c, in[k], forward_matrix(0) + k * kColumns + n);
                    } else {
#pragma unroll
                        for (int k = 0; k < kTiles; ++k)
                            multiply(c, hidden_[tile][layer - 1][k], forward_matrix(layer) + k * kColumns + n);
                    }
                    unsigned* h = hidden_[tile][layer][n / 2] + 2 * (n & 1);
                    h[0] = tensor::pack(fmaxf(c[0], 0.0f), fmaxf(c[1], 0.0f));
                    h[1] = tensor::pack(fmaxf(c[2], 0.0f), fmaxf(c[3], 0.0f));
                }
            float c[4] = {};
#pragma unroll
            for (int k = 0; k < kTiles; ++k) multiply(c, hidden_[tile][kLayers - 1][k], kForwardOutput + k);
            // A group's first lane holds the first two of the three columns, its second lane the third.
            float *upper = outputs(16 * tile + group()), *lower = outputs(16 * tile + group() + 8);
            if ((lane() & 3) == 0) upper[0] = c[0], upper[1] = c[1], lower[0] = c[2], lower[1] = c[3];
            if ((lane() & 3) == 1) upper[2] = c[0], lower[2] = c[2];
        }
        __syncwarp();
        const float* o = outputs(lane());
        output_ = {o[0], o[1], o[2]};
        return {tanhf(output_.x), tanhf(output_.y), tanhf(output_.z)};
    }

    template <bool kAdds = false>
    __device__ void backward(const float*, int width, const Vec3<float>& direction, int degree, bool active,
                             const Vec3<float>& dL_dresidual, float* gradients, Vec3<float>& dL_ddirection) {
        dL_ddirection = {0, 0, 0};
        float d[3] = {0, 0, 0};
        if (active)
            d[0] = tanh_derivative(output_.x) * dL_dresidual.x, d[1] = tanh_derivative(output_.y) * dL_dresidual.y,
            d[2] = tanh_derivative(output_.z) * dL_dresidual.z;
        const unsigned largest =
            __reduce_max_sync(~0u, __float_as_uint(fmaxf(fmaxf(fabsf(d[0]), fabsf(d[1])), fabsf(d[2]))));
        if (largest < 0x00800000u) return;  // all 0 (or subnormal)
        const unsigned exponent = min(259 - (largest >> 23), 247u);
        const float scale = __uint_as_float(exponent << 23), inverse = __uint_as_float((254 - exponent) << 23);
        __syncwarp();  // until all lanes have read their outputs
        *reinterpret_cast<uint4*>(outputs(lane())) =
            make_uint4(tensor::pack(d[0] * scale, d[1] * scale), tensor::pack(d[2] * scale, 0), 0, 0);
        __syncwarp();
#pragma unroll
        for (int tile = 0; tile < 2; ++tile) backward_tile<kAdds>(tile, inverse, width, gradients);
        __syncwarp();
        if (!active) return;
        float a[Model::kBases];
        const float4* of_bases = reinterpret_cast<const float4*>(stage_ + lane() * kStride);
#pragma unroll
        for (int k = 0; k < Model::kBases / 4; ++k) {
            const float4 v = of_bases[k];
            a[4 * k] = v.x, a[4 * k + 1] = v.y, a[4 * k + 2] = v.z, a[4 * k + 3] = v.w;
        }
        dL_ddirection = appearance::ShBasis::basis_gradient(direction, degree, a + 1) * inverse;
    }

    static __device__ void prepare(unsigned* prepared, int k, float w) {
        const int row = k / kNeurons, column = k % kNeurons;  // each row holds the weights of all neurons of a layer
        if (k >= Model::kFirstOutput) {
            const int output = row - Model::kFirstOutput / kNeurons;
            put(prepared, kForwardOutput, 1, column, output, w);
            put(prepared, kBackwardOutput, kColumns, output, column, w);
            return;
        }
        const int layer = row < kInputs ? 0 : 1 + (row - kInputs) / kNeurons,
                  from = row < kInputs ? row : (row - kInputs) % kNeurons;
        put(prepared, forward_matrix(layer), kColumns, from, column, w);
        put(prepared, backward_matrix(layer), layer == 0 ? kInColumns : kColumns, column, from, w);
    }

    __device__ void store_sums(float* sums) const {
        const auto put = [&](int at, float x) { sums[at] = x; };
        const int pair = 2 * (lane() & 3);
#pragma unroll
        for (int m = 0; m < kTiles; ++m) {
            const int to = 16 * m + group();
#pragma unroll
            for (int n = 0; n < kInColumns; ++n)
#pragma unroll
                for (int v = 0; v < 4; ++v)
                    put((8 * n + pair + (v & 1)) * kNeurons + to + 8 * (v >> 1), input_sums_[m][n][v]);
#pragma unroll
            for (int layer = 1; layer < kLayers; ++layer)
#pragma unroll
                for (int n = 0; n < kColumns; ++n)
#pragma unroll
                    for (int v = 0; v < 4; ++v)
                        put(Model::matrix(layer) + (8 * n + pair + (v & 1)) * kNeurons + to + 8 * (v >> 1),
                            hidden_sums_[layer - 1][m][n][v]);
        }
        if (group() >= 3) return;
#pragma unroll
        for (int n = 0; n < kColumns; ++n)
#pragma unroll
            for (int v = 0; v < 2; ++v)
                put(Model::kFirstOutput + group() * kNeurons + 8 * n + pair + v, output_sums_[n][v]);
    }

  private:
    static __device__ int lane() { return threadIdx.x & 31; }
    static __device__ int group() { return (threadIdx.x & 31) >> 2; }
    __device__ __half* inputs(int tile) const { return stage_ + 16 * tile * kStride; }
    __device__ float* outputs(int gaussian) const {
        return reinterpret_cast<float*>(stage_ + gaussian * kStride + kInputs);
    }
    __device__ void multiply(float (&c)[4], const unsigned (&a)[4], int fragment) const {
        const uint2 b = fragments_[fragment * 32];
        tensor::multiply(c, a, b.x, b.y);
    }
    /// Writes element (k, n) of a B operand whose tiles begin at fragment `first`, with `columns` tiles side by side.
    static __device__ void put(unsigned* prepared, int first, int columns, int k, int n, float w) {
        const int fragment = first + k / 16 * columns + n / 8, in_lane = n % 8 * 4 + k % 8 / 2;
        reinterpret_cast<__half*>(prepared)[((fragment * 32 + in_lane) * 2 + k % 16 / 8) * 2 + k % 2] =
            __float2half_rn(w);
    }

    /// Computes sine and cosine with an error of 1e-6, far below half precision, in a fifth of sincosf's instructions.
    struct SinCosForHalf {
        __device__ void operator()(float x, float& s, float& c) const {
            if (fabsf(x) < 1e4f) {
                const float turns = rintf(x * 0.159154943f);
                const float r =
                    fmaf(turns, 1.74845553e-7f, fmaf(turns, -6.28318548f, x));  // 2 pi = 6.28318548 - 1.74845553e-7
                __sincosf(r, &s, &c);
            } else {
                sincosf(x, &s, &c);
            }
        }
    };

    __device__ void stage_inputs(const float* features, const Vec3<float>& direction, int degree, bool active) {
        float x[kInputs] = {};
        if (active) Model::encode(features, direction, degree, x, SinCosForHalf{});
        __syncwarp();  // until all lanes have used the previous inputs
        uint4* to = reinterpret_cast<uint4*>(stage_ + lane() * kStride);
#pragma unroll
        for (int k = 0; k < kInputs; k += 8)
            to[k / 8] = make_uint4(tensor::pack(x[k], x[k + 1]), tensor::pack(x[k + 2], x[k + 3]),
                                   tensor::pack(x[k + 4], x[k + 5]), tensor::pack(x[k + 6], x[k + 7]));
        __syncwarp();
    }

    /// Transposes a 16x16 A operand.
    static __device__ void transposed(unsigned (&t)[4], const unsigned (&a)[4]) {
        t[0] = tensor::transpose(a[0]), t[1] = tensor::transpose(a[2]), t[2] = tensor::transpose(a[1]),
        t[3] = tensor::transpose(a[3]);
    }
    /// Adds inverse * A B to sum.
    static __device__ void add_product(float (&sum)[4], const unsigned (&a)[4], unsigned b0, unsigned b1,
                                       float inverse) {
        float c[4] = {};
        tensor::multiply(c, a, b0, b1);
#pragma unroll
        for (int v = 0; v < 4; ++v) sum[v] = fmaf(c[v], inverse, sum[v]);
    }
    /// Writes C tile n of a layer's gradient, zeroed for inactive neurons, as part of the next A operand.
    static __device__ void store_active(unsigned (&delta)[kTiles][4], int n, const float (&c)[4],
                                        const unsigned (&hidden)[kTiles][4]) {
#pragma unroll
        for (int row = 0; row < 2; ++row) {
            const float2 h = tensor::unpack(hidden[n / 2][2 * (n & 1) + row]);
            delta[n / 2][2 * (n & 1) + row] =
                tensor::pack(h.x > 0 ? c[2 * row] : 0.0f, h.y > 0 ? c[2 * row + 1] : 0.0f);
        }
    }

    template <bool kAdds> __device__ void backward_tile(int tile, float inverse, int width, float* gradients) {
        const auto put = [&](int gaussian, int feature, float gradient) {
            float& to = gradients[gaussian * width + feature];
            to = kAdds ? to + gradient : gradient;
        };
        unsigned delta[kTiles][4];
        {  // the output layer
            unsigned d0, d1;
            tensor::load_half(d0, d1, inputs(tile) + kInputs, kStride);
            const unsigned a[4] = {d0, d1, 0, 0}, at[4] = {tensor::transpose(d0), 0, tensor::transpose(d1), 0};
            const auto& h = hidden_[tile][kLayers - 1];
#pragma unroll
            for (int n = 0; n < kColumns; ++n) {
                float c[4] = {};
                tensor::multiply(c, at, tensor::transpose(h[n / 2][2 * (n & 1)]),
                                 tensor::transpose(h[n / 2][2 * (n & 1) + 1]));
                output_sums_[n][0] = fmaf(c[0], inverse, output_sums_[n][0]),
                output_sums_[n][1] = fmaf(c[1], inverse, output_sums_[n][1]);
                float e[4] = {};
                multiply(e, a, kBackwardOutput + n);
                store_active(delta, n, e, h);
            }
        }
#pragma unroll
        for (int layer = kLayers - 1; layer > 0; --layer) {
            const auto& h = hidden_[tile][layer - 1];
#pragma unroll
            for (int m = 0; m < kTiles; ++m) {
                unsigned t[4];
                transposed(t, delta[m]);
#pragma unroll
                for (int n = 0; n < kColumns; ++n)
                    add_product(hidden_sums_[layer - 1][m][n], t, tensor::transpose(h[n / 2][2 * (n & 1)]),
                                tensor::transpose(h[n / 2][2 * (n & 1) + 1]), inverse);
            }
            unsigned before[kTiles][4];
#pragma unroll
            for (int n = 0; n < kColumns; ++n) {
                float c[4] = {};
#pragma unroll
                for (int k = 0; k < kTiles; ++k) multiply(c, delta[k], backward_matrix(layer) + k * kColumns + n);
                store_active(before, n, c, h);
            }
#pragma unroll
            for (int k = 0; k < kTiles; ++k)
#pragma unroll
                for (int v = 0; v < 4; ++v) delta[k][v] = before[k][v];
        }
        unsigned t[kTiles][4];
#pragma unroll
        for (int m = 0; m < kTiles; ++m) transposed(t[m], delta[m]);
        unsigned encoded[kEncoded / 16][4];  // read before the gradient of the bases overwrites them
#pragma unroll
        for (int k = 0; k < kInTiles; ++k) {
            unsigned columns[4];
            tensor::load_columns(columns, inputs(tile) + 16 * k, kStride);
#pragma unroll
            for (int m = 0; m < kTiles; ++m) {
                add_product(input_sums_[m][2 * k], t[m], columns[0], columns[1], inverse);
                add_product(input_sums_[m][2 * k + 1], t[m], columns[2], columns[3], inverse);
            }
            if (k < kEncoded / 16) tensor::load(encoded[k], inputs(tile) + 16 * k, kStride);
        }
        __syncwarp();
        const int pair = 2 * (lane() & 3);
#pragma unroll
        for (int n = 0; n < kInColumns; ++n) {
            float c[4] = {};
#pragma unroll
            for (int k = 0; k < kTiles; ++k) multiply(c, delta[k], backward_matrix(0) + k * kInColumns + n);
#pragma unroll
            for (int row = 0; row < 2; ++row) {
                const int gaussian = 16 * tile + group() + 8 * row;
                if (8 * n >= kEncoded) {
                    reinterpret_cast<float2*>(stage_ + gaussian * kStride)[(8 * n - kEncoded + pair) / 2] =
                        make_float2(c[2 * row], c[2 * row + 1]);
                } else if (kFrequencies == 0) {
                    put(gaussian, 8 * n + pair, c[2 * row] * inverse);
                    put(gaussian, 8 * n + pair + 1, c[2 * row + 1] * inverse);
                } else {  // the pair is (sin f, cos f)
                    const float2 x = tensor::unpack(encoded[n / 2][2 * (n & 1) + row]);
                    put(gaussian, (8 * n + pair) / 2, (x.y * c[2 * row] - x.x * c[2 * row + 1]) * inverse);
                }
            }
        }
    }

    __half* stage_;
    const uint2* fragments_;                  ///< this lane's fragments
    unsigned hidden_[2][kLayers][kTiles][4];  ///< activations after ReLU, as A operands
    Vec3<float> output_;                      ///< output of this lane's Gaussian, before tanh
    float input_sums_[kTiles][kInColumns][4] = {},
          hidden_sums_[kLayers > 1 ? kLayers - 1 : 1][kTiles][kColumns][4] = {}, output_sums_[kColumns][2] = {};
};

}  // namespace gs
