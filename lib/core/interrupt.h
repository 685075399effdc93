// SPDX-License-Identifier: Apache-2.0
// What signals do: Ctrl-C becomes a flag that the trainer checks between iterations, so that it can write a checkpoint
// first, and a write that fails is an error like any other.
#pragma once

namespace gs {

/// Ignores SIGPIPE and SIGXFSZ, so that a write to a closed pipe or beyond the limit of a file's size fails with an
/// error and the program can say so, instead of ending without a word. Programs that run_process starts do not inherit
/// it.
void ignore_write_signals();

/// After this call the first SIGINT, SIGTERM or SIGHUP only sets a flag; a second one ends the program at once. A
/// SIGHUP that the program was started to ignore (nohup) stays ignored.
void catch_interrupts();

/// Returns true if a signal arrived since catch_interrupts().
bool interrupted();

}  // namespace gs
