// SPDX-License-Identifier: Apache-2.0
// What a machine reaches on its own: the ceilings that floors are computed from.
#pragma once

namespace gs {

struct Ceilings {
    double copy_bytes_per_second = 0;  ///< read + write of a copy much larger than the caches
    double operations_per_second = 0;  ///< single-precision FMAs, one per lane; an FMA counts once
};

/// Of the processor with all threads in use, best of five. Takes about a tenth of a second and 512 MiB.
Ceilings cpu_ceilings();

}  // namespace gs
