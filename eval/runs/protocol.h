// SPDX-License-Identifier: Apache-2.0
// Evaluation protocols as data. The conventions in circulation differ by more than the methods they compare.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/metrics/learned_metrics.h"
#include "eval/metrics/pixel_metrics.h"
#include "kernels/base/vec.h"

namespace gs {

/// One way to compare renders with photographs. Scores of different protocols do not compare.
struct Protocol {
    std::string name;    ///< word on the command line and in results.json
    std::string images;  ///< the photographs that are compared, and what resizes them
    bool eight_bit;      ///< true: both images are rounded to 8 bits; false: float, clamped to [0,1]
    SsimBorder ssim_border;
    LpipsNet lpips_net;
    LpipsRange lpips_range;
    std::optional<Vec3<float>> background;  ///< colour behind the scene; empty: that of the training
    std::string instead;                    ///< what gsapp does where it departs from the protocol; may be empty
};

/// Returns paper, inria and gsplat; the first is the default. Source: docs/evaluation.md.
const std::vector<Protocol>& protocols();

/// Returns whether a protocol has this name.
bool is_protocol(const std::string& name);

/// Returns the protocol of that name. Throws UsageError naming the known ones for another name.
const Protocol& find_protocol(const std::string& name);

/// Returns the key in results.json of the protocol's LPIPS: "LPIPS-VGG" or "LPIPS-Alex".
const char* lpips_metric(LpipsNet net);

/// Describes the protocol in one line, with the deviations from the protocol of that name: an SSIM border chosen by
/// hand, and a `background` of the rendered views that is not the protocol's. Scores compare where these lines are
/// equal.
std::string protocol_line(const Protocol& protocol, const Vec3<float>& background);

}  // namespace gs
