// SPDX-License-Identifier: Apache-2.0
// How models are stored for viewers: a few words per Gaussian, in which everything that does not depend on the view is
// computed (docs/formats.md#scenengsplat). The container is lib/export/ngsplat.h.
#pragma once

#include <cstdint>
#include <vector>

#include "appearance/packing_description.h"
#include "kernels/base/half.h"
#include "kernels/base/vec.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// What acts on a residual as stored; the lobes' amplitudes are stored behind it.
enum class PackedResidualActivation : std::uint32_t { kNone, kTanh, kSoftplus };

/// What the file says about its appearance. The fields are those of the format; a model uses those that its description
/// names.
struct PackedHeader {
    std::uint32_t model = 0;        ///< PackingDescription::id
    std::uint32_t features = 0;     ///< sites, lobes, or inputs of a network that belong to the Gaussian
    std::uint32_t frequencies = 0;  ///< in a network's encoding; for information, features are stored encoded
    std::uint32_t bands = 0;        ///< bit l: band l of spherical harmonics is stored, or an input of a network
    PackedResidualActivation activation = PackedResidualActivation::kNone;
    std::uint32_t neurons = 0, hidden_layers = 0;
    bool constant_input = true;  ///< the network has the constant Y_0 as an input
    bool folded = false;  ///< the first layer's sums over what does not depend on the view are stored, not the features
    std::vector<float> floats = {};  ///< PackingDescription::num_floats of them
};

/// Sizes that follow from a header.
struct PackedLayout {
    std::vector<int> texture_words;  ///< 32-bit words of a Gaussian in each texture: 4 or 2
    std::int64_t weight_halves = 0;  ///< halves of the shared weights

    int bytes_per_gaussian() const {
        int words = 0;
        for (const int w : texture_words) words += w;
        return 4 * words;
    }
};

struct PackedAppearance {
    PackedHeader header;
    std::vector<std::uint16_t> weights;                ///< halves, in the file's order
    std::int64_t rows = 0;                             ///< the number K of Gaussians with a residual: the first ones
    std::vector<std::vector<std::uint32_t>> textures;  ///< (K, texture_words) each
};

/// What a model's folder gives to put it into a file and to show what is in one.
struct Packing {
    const PackingDescription* description;
    /// Returns header, weights and zeroed textures; degrees above the active one are left out, or can have no effect.
    /// Parameters are finite.
    PackedAppearance (*prepare)(const Gaussians& gaussians);
    /// Fills the row of one Gaussian with a residual; different rows from different threads.
    void (*pack_row)(const Gaussians& gaussians, std::int64_t row, PackedAppearance& packed);
    /// The residual of one Gaussian that has one, as a viewer computes it, in double. `direction` is a unit vector from
    /// the camera to the Gaussian.
    Vec3<double> (*residual)(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction);
};

/// Halves lie eight to a texel of four words, the first in the low half of a word; the last texel is filled up with
/// zeros.
inline constexpr int kHalvesPerTexel = 8, kMaxHalves = 64;

/// Sets half `k` of Gaussian `row`.
inline void set_half(PackedAppearance& packed, std::int64_t row, int k, double value) {
    std::uint32_t& word =
        packed.textures[std::size_t(k / kHalvesPerTexel)][std::size_t(4 * row + k % kHalvesPerTexel / 2)];
    const int shift = k % 2 * 16;
    word = (word & ~(0xffffu << shift)) | std::uint32_t(half_bits(value)) << shift;
}
inline double get_half(const PackedAppearance& packed, std::int64_t row, int k) {
    const std::uint32_t word =
        packed.textures[std::size_t(k / kHalvesPerTexel)][std::size_t(4 * row + k % kHalvesPerTexel / 2)];
    return half_value(std::uint16_t(word >> (k % 2 * 16)));
}

/// The sizes that the description of the header's model gives. Throws DataError saying which field has a value that the
/// model cannot have.
PackedLayout packed_layout(const PackedHeader& header);

/// Returns zeroed weights, and textures of that header for the Gaussians of `gaussians` with a residual.
PackedAppearance make_packed(const PackedHeader& header, const Gaussians& gaussians);

/// Returns the residual of any Gaussian, which is 0 where it has none.
Vec3<double> packed_residual(const Packing& packing, const PackedAppearance& packed, std::int64_t row,
                             const Vec3<double>& direction);

/// Returns alpha of a stored residual.
Vec3<double> packed_activation(PackedResidualActivation kind, const Vec3<double>& x);

/// The packing of the models with this number in files. Throws DataError where no model has it.
const Packing& packing_of(std::uint32_t model);

}  // namespace gs
