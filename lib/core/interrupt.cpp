// SPDX-License-Identifier: Apache-2.0
// Signal handlers that touch nothing but one flag.
#include "lib/core/interrupt.h"

#include <csignal>

namespace gs {
namespace {

volatile std::sig_atomic_t signal_arrived = 0;

extern "C" void on_signal(int) {
    signal_arrived = 1;
    // Back to the default action: whoever asks twice does not want to wait for a checkpoint.
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
