// SPDX-License-Identifier: Apache-2.0
// Installs signal handlers that only set a flag.
#include "lib/core/interrupt.h"

#include <csignal>

namespace gs {
namespace {

volatile std::sig_atomic_t signal_arrived = 0, catches_hangup = 0;

extern "C" void on_signal(int) {
    signal_arrived = 1;
    // Restores the default action: after a second signal the user does not want to wait for a checkpoint.
    std::signal(SIGINT, SIG_DFL);
    std::signal(SIGTERM, SIG_DFL);
    if (catches_hangup) std::signal(SIGHUP, SIG_DFL);
}

}  // namespace

void ignore_write_signals() {
    std::signal(SIGPIPE, SIG_IGN);
    std::signal(SIGXFSZ, SIG_IGN);
}

void catch_interrupts() {
    signal_arrived = 0;
    std::signal(SIGINT, on_signal);
    std::signal(SIGTERM, on_signal);
    struct sigaction hangup {};
    ::sigaction(SIGHUP, nullptr, &hangup);
    catches_hangup = hangup.sa_handler != SIG_IGN;
    if (catches_hangup) std::signal(SIGHUP, on_signal);
}

bool interrupted() { return signal_arrived != 0; }

}  // namespace gs
