// SPDX-License-Identifier: Apache-2.0
// Writes the measurements of a bench as text.
#include <fmt/format.h>

#include <algorithm>

#include "eval/bench/bench.h"
#include "lib/train/memory_plan.h"

namespace gs {
namespace {

/// A stage that takes longer than this many floors needs a reason.
constexpr double kWellAboveFloor = 3;

std::string frame_lines(const BenchResult& r) {
    std::string out = "| frames | ms/frame | FPS |\n|---|---:|---:|\n";
    for (const FrameTime& f : r.frames)
        out += fmt::format("| {}x{}, {} views | {:.3f} | {:.1f} |\n", f.width, f.height, f.num_views, 1e3 * f.seconds,
                           f.seconds > 0 ? 1 / f.seconds : 0);
    return out;
}

std::string iteration_lines(const BenchResult& r) {
    double sum = 0;
    for (const StageCost& s : r.stages) sum += s.seconds;
    std::string out = fmt::format(
        "iteration at {}x{}: {:.3f} ms (mean of {} in a row), {:.3f} ms (median of {} that are each waited for)\n",
        r.width, r.height, 1e3 * r.iteration_seconds, r.repeat, 1e3 * r.iteration_seconds_median, r.repeat);
    out += fmt::format("with marks between the stages: {:.3f} ms in a row, {:+.1f} %; the stages add up to {:.3f} ms\n",
                       1e3 * r.marked_iteration_seconds,
                       r.iteration_seconds > 0 ? 100 * (r.marked_iteration_seconds / r.iteration_seconds - 1) : 0,
                       1e3 * sum);
    if (r.default_seconds && r.deterministic_seconds)
        out += fmt::format("with --deterministic {:.3f} ms, without {:.3f} ms: {:.2f} times\n",
                           1e3 * *r.deterministic_seconds, 1e3 * *r.default_seconds,
                           *r.deterministic_seconds / *r.default_seconds);
    return out;
}

std::string stage_line(const StageCost& s, const Ceilings& ceilings) {
    const double copy = s.bytes / ceilings.copy_bytes_per_second, fma = s.operations / ceilings.operations_per_second,
                 floor = std::max(copy, fma);
    const double ratio = floor > 0 ? s.seconds / floor : 0;
    const bool above = ratio > kWellAboveFloor;
    const std::string ratio_text = floor > 0 ? fmt::format("{:.1f}", ratio) : "-";
    return fmt::format("| {} | {:.3f} | {:.3g} M {} | {:.3f} | {:.3f} | {} | {} | {} |\n", s.stage, 1e3 * s.seconds,
                       s.items / 1e6, s.item, s.items > 0 ? 1e9 * s.seconds / s.items : 0, 1e3 * floor,
                       floor <= 0   ? "-"
                       : copy > fma ? "copy"
                                    : "FMA",
                       above ? "**" + ratio_text + "**" : ratio_text,
                       !above           ? ""
                       : s.note.empty() ? "none given"
                                        : s.note);
}

}  // namespace

std::string format_bench(const BenchResult& r) {
    std::string out =
        fmt::format("{}\n{}; {} Gaussians; copy {:.1f} GB/s, {:.0f} G single-precision FMA/s\n\n", r.subject, r.device,
                    r.num_gaussians, r.ceilings.copy_bytes_per_second / 1e9, r.ceilings.operations_per_second / 1e9);
    out += frame_lines(r) + "\n" + iteration_lines(r) + "\n";
    out +=
        "| stage | ms | items | ns per item | floor ms | bound by | measured/floor | reason "
        "|\n|---|---:|---:|---:|---:|---|---:|---|\n";
    for (const StageCost& s : r.stages) out += stage_line(s, r.ceilings);
    if (!r.without_residual.empty()) {
        out +=
            "\n| appearance in | ms | items | ns per item | floor ms | bound by | measured/floor | reason "
            "|\n|---|---:|---:|---:|---:|---|---:|---|\n";
        for (std::size_t k = 0; k < r.stages.size(); ++k)
            if (r.stages[k].evaluates_appearance) out += stage_line(appearance_share(r, k), r.ceilings);
    }
    if (r.memory.peak > 0) out += "\n" + memory_report(r.memory) + "\n";
    return out;
}

}  // namespace gs
