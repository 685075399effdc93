// SPDX-License-Identifier: Apache-2.0
// Installs signal handlers that only set a flag.
#include "lib/core/interrupt.h"

#include <csignal>

namespace gs {
namespace {

volatile std::sig_atomic_t signal_arrived = 0;

extern "C" void on_signal(int) {
    signal_arrived = 1;
    // Restores the default action, because a second signal means that the user does not want to wait for a checkpoint.
    std::signal(SIGINT, SIG_DFL);
    std::signal(SIGTERM, SIG_DFL);
}

}  // namespace

void catch_interrupts() {
    signal_arrived = 0;
    std::signal(SIGINT, on_signal);
    std::signal(SIGTERM, on_signal);
}

bool interrupted() { return signal_arrived != 0; }

}  // namespace gs
