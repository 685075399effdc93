// SPDX-License-Identifier: Apache-2.0
// Signal handling. Ctrl-C sets a flag that the trainer checks between iterations, so that it can write a checkpoint
// first; a failed write causes an ordinary error instead of a signal.
#pragma once

namespace gs {

/// Ignores SIGPIPE and SIGXFSZ, so that a write to a closed pipe or beyond the file size limit fails with an error that
/// the program can report, instead of ending the program silently. Programs started by run_process do not inherit this.
void ignore_write_signals();

/// Installs signal handlers: the first SIGINT, SIGTERM or SIGHUP only sets a flag, a second one ends the program at
/// once. SIGHUP stays ignored if the program was started that way (nohup).
void catch_interrupts();

/// Returns whether a signal arrived since catch_interrupts().
bool interrupted();

}  // namespace gs
