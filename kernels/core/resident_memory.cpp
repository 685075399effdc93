// SPDX-License-Identifier: Apache-2.0
// Reads what Linux says of the process.
#include "kernels/core/resident_memory.h"

#include <unistd.h>

#include <fstream>

namespace gs {

std::int64_t resident_bytes() {
    std::int64_t all = 0, resident = 0;  // pages
    std::ifstream("/proc/self/statm") >> all >> resident;
    return resident * ::sysconf(_SC_PAGESIZE);
}

}  // namespace gs
