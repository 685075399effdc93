// SPDX-License-Identifier: Apache-2.0
// What a model loses when it is packed for viewers, measured on pictures.
#pragma once

#include "eval/runs/saved_run.h"
#include "lib/export/ngsplat.h"

namespace gs {

struct PackingLoss {
    double psnr = 0;         ///< of the model, dB, mean over the test views
    double packed_psnr = 0;  ///< of the decoded file, drawn by the same renderer and corrected the same way
};

/// Both against the photographs, by the protocol `paper`. The decoded colours of each view are evaluated in double and drawn as a
/// model without view dependence. Needs a test view.
PackingLoss packing_loss(SavedRun& run, const PackedScene& scene);

/// The photometric block of a run with PPISP: predictions of the controllers for the test views. Renders each once.
PackedPpisp packed_correction(SavedRun& run);

}  // namespace gs
