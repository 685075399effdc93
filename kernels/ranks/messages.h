// SPDX-License-Identifier: Apache-2.0
// The structures of the Backend interface as messages between ranks.
#pragma once

#include "kernels/ranks/message.h"
#include "kernels/requests.h"

namespace gs {

/// A step goes without the pixels of its target, which the rank that renders the view reads by the target's id.
void put(MessageWriter& to, const StepRequest& request);
void get(MessageReader& from, StepRequest& request);
void put(MessageWriter& to, const std::vector<StepRequest>& requests);
void get(MessageReader& from, std::vector<StepRequest>& requests);

void put(MessageWriter& to, const Gaussians& model);
void get(MessageReader& from, Gaussians& model);
void put(MessageWriter& to, const PpispState& state);
void get(MessageReader& from, PpispState& state);

}  // namespace gs
