// SPDX-License-Identifier: Apache-2.0
// Measures on pictures what a model loses when it is packed for viewers.
#pragma once

#include "eval/runs/saved_run.h"
#include "lib/export/ngsplat.h"

namespace gs {

/// The scores before and after packing.
struct PackingLoss {
    double psnr = 0;         ///< dB, of the model; mean over the test views
    double packed_psnr = 0;  ///< dB, of the decoded file, drawn and corrected the same way
};

/// Returns the mean PSNR of the test views as the decoded file shows them, as packing_loss measures it.
double packed_psnr(SavedRun& run, const PackedScene& scene);

/// Scores the model and the decoded file against the photographs by the protocol `paper`. The decoded colours of each
/// view are evaluated in double and drawn as a model without view dependence. Throws UsageError without test views.
PackingLoss packing_loss(SavedRun& run, const PackedScene& scene);

/// Returns the photometric block of a run with PPISP, with the corrections of `views`. Renders each of them once.
PackedPpisp packed_correction(SavedRun& run, const std::vector<View>& views);

}  // namespace gs
