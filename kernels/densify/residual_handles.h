// SPDX-License-Identifier: Apache-2.0
// Makes row operations independent of whether only some Gaussians of a model have a residual.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns the handle of row k of the residuals while rows move: an integer stored in the bits of a float. 0 refers to
/// no row; for moments it stands for a row of zeros.
inline float residual_handle(std::int64_t k) { return std::bit_cast<float>(std::uint32_t(k + 1)); }
inline std::int64_t row_of_handle(float handle) { return std::int64_t(std::bit_cast<std::uint32_t>(handle)) - 1; }

/// Replaces the residual and its moments of each Gaussian of a mixed model by handles for the lifetime of the object,
/// as groups of one column. Rows and copies of rows carry their handles along. resolve() converts the handles back to
/// rows: rows with a residual come first, in their order. For any other model it does nothing.
class ResidualHandles {
  public:
    /// With `always`, also handles a model whose Gaussians all have a residual.
    explicit ResidualHandles(Gaussians& state, bool always = false);
    /// Restores the original residuals, unless they were resolved.
    ~ResidualHandles();
    ResidualHandles(const ResidualHandles&) = delete;
    ResidualHandles& operator=(const ResidualHandles&) = delete;

    /// Removes the residual of Gaussians without a mark, as Backend::keep_residuals does.
    void keep(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases);
    void resolve();

  private:
    Gaussians& state_;
    bool active_;
    GroupArrays<float> residuals_;
};

}  // namespace gs
