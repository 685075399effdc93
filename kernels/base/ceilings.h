// SPDX-License-Identifier: Apache-2.0
// The peak rates of a machine, from which the shortest possible times of stages are computed.
#pragma once

namespace gs {

/// The peak bandwidth and arithmetic rate of a machine.
struct Ceilings {
    double copy_bytes_per_second = 0;  ///< read + write of a copy much larger than the caches
    double operations_per_second = 0;  ///< single-precision FMAs, one per lane; an FMA counts once
};

/// Measures the processor with all threads in use, best of five. Takes about a tenth of a second and 512 MiB.
Ceilings cpu_ceilings();

}  // namespace gs
