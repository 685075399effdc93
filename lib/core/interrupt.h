// SPDX-License-Identifier: Apache-2.0
// Ctrl-C as a question the trainer asks between iterations, so that it can write a checkpoint first.
#pragma once

namespace gs {

/// From now on the first SIGINT or SIGTERM only sets a flag; a second one ends the program at once.
void catch_interrupts();

/// Whether a signal arrived since catch_interrupts().
bool interrupted();

}  // namespace gs
