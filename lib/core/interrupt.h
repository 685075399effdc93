// SPDX-License-Identifier: Apache-2.0
// Turns Ctrl-C into a flag that the trainer checks between iterations, so that it can write a checkpoint first.
#pragma once

namespace gs {

/// After this call the first SIGINT or SIGTERM only sets a flag; a second one ends the program at once.
void catch_interrupts();

/// Returns true if a signal arrived since catch_interrupts().
bool interrupted();

}  // namespace gs
