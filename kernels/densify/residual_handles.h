// SPDX-License-Identifier: Apache-2.0
// Lets row operations treat a model in which only some Gaussians have a residual like any other.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// The number that stands for row k of the residuals while rows move: its bits in the place of a float. 0 stands for no
/// row; as a moment it is a row of moments of 0.
inline float residual_handle(std::int64_t k) { return std::bit_cast<float>(std::uint32_t(k + 1)); }
inline std::int64_t row_of_handle(float handle) { return std::int64_t(std::bit_cast<std::uint32_t>(handle)) - 1; }

/// For its lifetime each Gaussian of a mixed model has handles of its residual and of its moments in place of them, as
/// groups of one column. Rows and copies of rows carry their handles along. resolve() makes rows of the handles: those
/// with a residual come first, in their order. For any other model it does nothing.
class ResidualHandles {
  public:
    /// `always`: for a model whose Gaussians all have a residual, too.
    explicit ResidualHandles(Gaussians& state, bool always = false);
    /// Puts the residuals back as they were, unless they were resolved.
    ~ResidualHandles();
    ResidualHandles(const ResidualHandles&) = delete;
    ResidualHandles& operator=(const ResidualHandles&) = delete;

    /// Takes the residual from the Gaussians without a mark, as Backend::keep_residuals does.
    void keep(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases);
    void resolve();

  private:
    Gaussians& state_;
    bool active_;
    GroupArrays<float> residuals_;
};

}  // namespace gs
