// SPDX-License-Identifier: Apache-2.0
// Gaussian-tile pairs on the CPU.
#pragma once

#include <cstdint>

namespace gs {

/// One (Gaussian, tile) pair.
struct Instance {
    std::uint32_t gaussian;
    std::uint32_t slot;  ///< position in Gaussian-major order: the instances of one Gaussian are neighbours there
};

}  // namespace gs
