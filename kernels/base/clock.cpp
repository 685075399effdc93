// SPDX-License-Identifier: Apache-2.0
// Reads the process's resource use from Linux.
#include "kernels/base/clock.h"

#include <unistd.h>

#include <ctime>
#include <fstream>

namespace gs {

std::int64_t resident_bytes() {
    std::int64_t all = 0, resident = 0;  // pages
    std::ifstream("/proc/self/statm") >> all >> resident;
    return resident * ::sysconf(_SC_PAGESIZE);
}

double cpu_seconds() {
    timespec time{};
    ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

}  // namespace gs
