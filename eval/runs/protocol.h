// SPDX-License-Identifier: Apache-2.0
// How scores are made, as data: the conventions in circulation differ by more than the methods they compare.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/metrics/lpips.h"
#include "eval/metrics/ssim.h"
#include "kernels/core/vec.h"

namespace gs {

/// One way to compare renders with photographs. Scores of different ones do not compare.
struct Protocol {
    std::string name;    ///< as on the command line and in results.json
    std::string images;  ///< which photographs are compared, and what resizes them
    bool eight_bit;      ///< both are rounded to 8 bits first; otherwise compared as float, clamped to [0,1]
    SsimBorder ssim_border;
    LpipsNet lpips_net;
    LpipsRange lpips_range;
    std::optional<Vec3<float>> background;  ///< behind the scene; empty: whatever the run was trained on
    std::string instead;                    ///< what gsapp does where it cannot follow; empty: it follows
};

/// paper, inria, gsplat; the first is the default. Source: docs/evaluation.md.
const std::vector<Protocol>& protocols();

bool is_protocol(const std::string& name);

/// Throws UsageError naming the known ones.
const Protocol& find_protocol(const std::string& name);

/// The column of results.json that holds the protocol's LPIPS: "LPIPS-VGG" or "LPIPS-Alex".
const char* lpips_metric(LpipsNet net);

/// One line that says all of it, and what deviates from the protocol of that name: an SSIM border chosen by hand, and a `background` (of
/// the views that were rendered) that is not the protocol's. Scores compare where these lines are equal.
std::string protocol_line(const Protocol& protocol, const Vec3<float>& background);

}  // namespace gs
