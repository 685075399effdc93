// SPDX-License-Identifier: Apache-2.0
// The structures of the Backend interface as messages between ranks.
#pragma once

#include "kernels/ranks/message.h"
#include "kernels/requests.h"

namespace gs {

/// A step without the pixels of its target, which the rank that renders the view reads by the target's id.
void put(MessageWriter& to, const StepRequest& request);
StepRequest get_step(MessageReader& from);
void put(MessageWriter& to, const std::vector<StepRequest>& requests);
std::vector<StepRequest> get_steps(MessageReader& from);

void put(MessageWriter& to, const Gaussians& model);
Gaussians get_gaussians(MessageReader& from);
void put(MessageWriter& to, const PpispState& state);
PpispState get_ppisp(MessageReader& from);

}  // namespace gs
