// SPDX-License-Identifier: Apache-2.0
// Adam's moments of the residuals in the format of the kernels: two floats, or one word (packed_moments.h).
#pragma once

#include "kernels/cuda/cuda.h"
#include "kernels/optimizer/packed_moments.h"

namespace gs {

/// Rows of moments. Offsets are in values.
struct MomentRows {
    float* m;
    float* v;  ///< null if m holds packed words of both moments

    __device__ MomentRows at(std::int64_t first) const { return {m + first, v ? v + first : nullptr}; }
    /// Loads the moments of a value as they are stored. They are unpacked later, so that several loads are in flight at
    /// once.
    __device__ void load(int at, float& mm, float& vv) const {
        mm = m[at];
        if (v) vv = v[at];
    }
    /// Unpacks the result of load() to both moments.
    __device__ void unpack(float& mm, float& vv) const {
        if (v) return;
        const unsigned word = __float_as_uint(mm);
        mm = __uint_as_float(first_moment_bits(word)), vv = __uint_as_float(second_moment_bits(word));
    }
    /// Stores both moments of a value. `seed` depends on the rows and the step.
    __device__ void store(int at, float mm, float vv, std::uint32_t seed) const {
        if (v)
            m[at] = mm, v[at] = vv;
        else
            m[at] = word(mm, vv, seed, at);
    }
    /// Loads the moments of the four values from 4 * at on, like load().
    __device__ void load4(int at, float4& mm, float4& vv) const {
        mm = reinterpret_cast<const float4*>(m)[at];
        if (v) vv = reinterpret_cast<const float4*>(v)[at];
    }
    __device__ void unpack4(float4& mm, float4& vv) const {
        unpack(mm.x, vv.x), unpack(mm.y, vv.y), unpack(mm.z, vv.z), unpack(mm.w, vv.w);
    }
    __device__ void store4(int at, float4 mm, float4 vv, std::uint32_t seed) const {
        if (v) {
            reinterpret_cast<float4*>(m)[at] = mm, reinterpret_cast<float4*>(v)[at] = vv;
            return;
        }
        const std::uint32_t k = 4 * at;
        reinterpret_cast<float4*>(m)[at] = make_float4(word(mm.x, vv.x, seed, k), word(mm.y, vv.y, seed, k + 1),
                                                       word(mm.z, vv.z, seed, k + 2), word(mm.w, vv.w, seed, k + 3));
    }

  private:
    __device__ static float word(float mm, float vv, std::uint32_t seed, std::uint32_t k) {
        return __uint_as_float(pack_moments(__float_as_uint(mm), __float_as_uint(vv), rounding_bits(seed, k)));
    }
};

}  // namespace gs
