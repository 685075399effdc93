// SPDX-License-Identifier: Apache-2.0
// A stress test of training: a part of the first Gaussians gets extreme finite values.
#pragma once

#include <cstdint>

#include "kernels/base/rng.h"
#include "kernels/state/gaussian_state.h"

namespace gs::test {

/// The random numbers of one row, drawn in blocks of four.
class Draws {
  public:
    Draws(std::uint64_t seed, std::int64_t row) : seed_(seed), row_(std::uint64_t(row)) {}
    std::uint32_t next() {
        if (used_ == 4) block_ = philox(seed_, RngStream::kHostile, row_, minor_++), used_ = 0;
        return block_.v[used_++];
    }
    float signed_value(float magnitude) { return next() % 2 ? magnitude : -magnitude; }

  private:
    std::uint64_t seed_, row_;
    std::uint32_t minor_ = 0;
    Philox4 block_{};
    int used_ = 4;
};

/// Sets every raw parameter but the mean of a share (0..1) of the Gaussians to an extreme: opacity +-50, each log scale
/// -30, 2 or 30, rotation components all +-1e-20, +-1e-3, +-1e3 or +-1e20, base colours all +-3 or all +-1e4, residuals
/// all +-1e-6, +-1e4 or +-1e30. The choice depends only on the seed and the row. Returns the number of changed
/// Gaussians.
inline std::int64_t make_hostile(Gaussians& state, double share, std::uint64_t seed) {
    // Some values no view can show: huge scales, rotations whose squares leave float's range. Others stay visible,
    // because a Gaussian that is culled puts no stress on the training.
    constexpr float kScales[] = {-30, 2, 30}, kRotations[] = {1e-20f, 1e-3f, 1e3f, 1e20f}, kBases[] = {3, 1e4f},
                    kResiduals[] = {1e-6f, 1e4f, 1e30f};
    std::int64_t changed = 0;
    for (std::int64_t i = 0; i < state.count; ++i) {
        Draws draws(seed, i);
        if (uniform_from_bits<double>(draws.next()) >= share) continue;
        ++changed;
        // One magnitude for the row. Of eight or 45 independent ones, some would always be among those that pruning
        // finds.
        const float rotation = kRotations[draws.next() % 4], base = kBases[draws.next() % 2],
                    residual = kResiduals[draws.next() % 3];
        const auto each = [&](Group g, auto value) {
            const int width = state[g].width;
            for (int k = 0; k < width; ++k) state[g].param[std::size_t(i) * width + k] = value();
        };
        each(Group::kScale, [&] { return kScales[draws.next() % 3]; });
        each(Group::kRotation, [&] { return draws.signed_value(rotation); });
        each(Group::kOpacity, [&] { return draws.signed_value(50); });
        each(Group::kBase, [&] { return draws.signed_value(base); });
        each(Group::kResidual, [&] { return draws.signed_value(residual); });
    }
    return changed;
}

}  // namespace gs::test
