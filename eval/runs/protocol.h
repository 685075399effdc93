// SPDX-License-Identifier: Apache-2.0
// Evaluation protocols as data. Published conventions change the scores by more than the methods differ.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/metrics/learned_metrics.h"
#include "eval/metrics/pixel_metrics.h"
#include "kernels/base/vec.h"

namespace gs {

/// One way to compare renders with photographs. Scores of different protocols are not comparable.
struct Protocol {
    std::string name;    ///< name on the command line and in results.json
    std::string images;  ///< source of the photographs, and the filter that resizes them
    bool eight_bit;      ///< true: both images are rounded to 8 bits; false: float, clamped to [0,1]
    SsimBorder ssim_border;
    LpipsNet lpips_net;
    LpipsRange lpips_range;
    std::optional<Vec3<float>> background;  ///< colour behind the scene; empty: the training background
    std::string instead;                    ///< deviation of gsapp from the protocol; may be empty
};

/// Returns the protocols paper, inria and gsplat; the first is the default. Source: docs/evaluation.md.
const std::vector<Protocol>& protocols();

/// Returns whether a protocol has this name.
bool is_protocol(const std::string& name);

/// Returns the protocol with this name. Throws UsageError listing the known names for any other name.
const Protocol& find_protocol(const std::string& name);

/// Returns the key of the net's LPIPS in results.json: "LPIPS-VGG" or "LPIPS-Alex".
const char* lpips_metric(LpipsNet net);

/// Describes the protocol in one line, including deviations from the standard protocol of that name: an SSIM border
/// chosen by the user, and a `background` of the rendered views that differs from the protocol's. Scores are comparable
/// only if these lines are equal.
std::string protocol_line(const Protocol& protocol, const Vec3<float>& background);

}  // namespace gs
