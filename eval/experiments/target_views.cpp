// SPDX-License-Identifier: Apache-2.0
// Holds views out and measures them.
#include "eval/experiments/target_views.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "eval/auto/held_out.h"
#include "eval/report/comparison.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

std::vector<Photograph> take_views(Scene& scene, const Vec3<float>& background) {
    if (scene.train.size() < kFewestViews)
        throw UsageError(fmt::format("option target-psnr: {} training views are too few to hold one out; {} are needed",
                                     scene.train.size(), kFewestViews));
    std::vector<View> held_out, rest;
    for (std::size_t k = 0; k < scene.train.size(); ++k)
        (is_held_out(k) ? held_out : rest).push_back(std::move(scene.train[k]));
    scene.train = std::move(rest);
    return load_photographs(held_out, background);
}

}  // namespace

TargetViews::TargetViews(const TrainOptions& options, Scene& scene)
    : background_(options.background.color), photographs_(take_views(scene, background_)) {
    if (photographs_.empty())
        throw UsageError("option target-psnr: masks leave no pixel of the views that were held out");
}

HeldOutPsnr TargetViews::psnr(Backend& backend) const {
    const std::vector<double> all = psnrs(backend, photographs_, background_, backend.download_ppisp().active());
    const ColumnStats stats = column_stats(all, Better::kHigher);
    return {stats.mean, stats.deviation.value_or(0) / std::sqrt(double(all.size()))};
}

}  // namespace gs
