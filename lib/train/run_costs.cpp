// SPDX-License-Identifier: Apache-2.0
// Logs the memory plan, and estimates the cost of the remaining steps from the measured steps.
#include "lib/train/run_costs.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "appearance/model_info.h"
#include "lib/core/log.h"
#include "lib/core/quantities.h"
#include "lib/train/choose_backend.h"
#include "lib/train/densification.h"
#include "lib/train/timeline.h"

namespace gs {
namespace {

/// The time of a pixel relative to a Gaussian in a step on the CPU. Measured on two idle cores: 0.27 us per Gaussian,
/// and per pixel 0.10 us for bonsai at 200x133 and 0.11 us for builtin:glossy.
constexpr double kPixelPerGaussian = 0.4;
/// The seconds of steps needed for an estimate of the training time, and the smallest estimate that is reported.
constexpr double kMeasuredSeconds = 3, kLongTraining = 3600;
/// The largest number of steps that are evaluated one by one. In a longer run each evaluated step represents several.
constexpr std::int64_t kMostSamples = 30000;

}  // namespace

void log_memory_plan(const TrainOptions& options, const Scene& scene, const AppearanceSpec& appearance,
                     std::int64_t num_gaussians) {
    constexpr double kMiB = 1024.0 * 1024.0;
    double images = 0, pixels = 0;
    for (const View& v : scene.train) {
        images += double(v.image_bytes);
        pixels = std::max(pixels, double(v.camera.width) * v.camera.height);
    }
    const double budget = double(options.image_cache.count);
    const int residual = appearance_model(appearance.model).residual_width(appearance.max_degree);
    // Bytes of the parameters, two Adam moments and the buffers of a step. CPU, per Gaussian: splat 40, tile list and
    // counts 8, depth key 8, last step 4 bytes; per pixel: image, transmittance, gradient, target, nine SSIM derivative
    // maps. CUDA: the values printed by `gsapp bench`.
    const bool cuda = uses_cuda(options.device);
    const bool packed = cuda && options.appearance_moments == AppearanceMoments::kBf16;
    const double per_gaussian = 12.0 * (3 + 3 + 4 + 1 + 3) + (packed ? 8.0 : 12.0) * residual + (cuda ? 104 : 60),
                 per_pixel = cuda ? 60 : 4.0 * (3 + 1 + 3 + 3 + 9);
    const int per_instance = (cuda ? 21 : 58) + (cuda && options.deterministic ? 288 : 0);
    const std::int64_t most =
        options.strategy == Strategy::kNone ? num_gaussians : std::max(num_gaussians, options.cap_max);
    log_debug(
        "memory plan: images {:.0f} MiB{}; {} Gaussians x {:.0f} B = {:.0f} MiB now, {:.0f} MiB at {}; {:.0f} MiB for "
        "a view of {:.1f} Mpx, plus "
        "{} B per Gaussian-tile instance",
        std::min(images, budget) / kMiB,
        images > budget
            ? " (all: " + std::to_string(std::int64_t(images / kMiB)) + " MiB, re-read beyond --image-cache)"
            : "",
        num_gaussians, per_gaussian, per_gaussian * double(num_gaussians) / kMiB, per_gaussian * double(most) / kMiB,
        most, per_pixel * pixels / kMiB, pixels / 1e6, per_instance);
    const double total = std::min(images, budget) + per_gaussian * double(most) + per_pixel * pixels;
    const double memory = double(sysconf(_SC_PHYS_PAGES)) * double(sysconf(_SC_PAGE_SIZE));
    if (total > memory)
        log_warning(
            "the planned {:.0f} MiB exceed this machine's memory of {:.0f} MiB: lower --cap-max, --image-cache or "
            "--resolution",
            total / kMiB, memory / kMiB);
}

std::string memory_report(const MemoryUse& memory) {
    constexpr double kMiB = 1024.0 * 1024.0;
    std::string text = fmt::format("device memory: peak {:.1f} MiB, now {:.1f} MiB", double(memory.peak) / kMiB,
                                   double(memory.bytes) / kMiB);
    for (const MemoryUse::Row& row : memory.rows) {
        text += fmt::format("{} {} {:.1f} MiB", &row == &memory.rows.front() ? ":" : ",", row.what,
                            double(row.bytes) / kMiB);
        if (row.items > 0) text += fmt::format(" ({:.0f} B a {})", double(row.bytes) / row.items, row.item);
    }
    return text;
}

void log_exchanges(const RankCosts& costs) {
    constexpr double kMegabyte = 1e6;
    if (costs.steps == 0 || costs.traffic.sent == 0) return;
    log_info("ranks: rank 0 sent {:.2f} MB in a step and spent {:.0f} % of it in exchanges, waiting included",
             costs.traffic.sent / double(costs.steps) / kMegabyte, 100 * costs.traffic.seconds / costs.seconds);
}

double estimate_seconds(const ScheduleOptions& options, const DensificationOptions& growth, const MeasuredSteps& steps,
                        std::int64_t cap) {
    const DensificationWindow window(growth);
    const auto cost = [&](const ScheduleMoment& moment, double count) {
        const bool coarse = moment.position < options.coarse_until * kReferenceIterations;
        return count + kPixelPerGaussian * steps.pixels / (coarse ? 4 : 1);
    };
    const double measured_cost = cost(moment_at(options, steps.iteration), double(steps.num_gaussians));
    const std::int64_t stride = 1 + (options.iterations - 1) / kMostSamples;
    double count = double(steps.num_gaussians), total = 0;
    ScheduleMoment last = moment_at(options, steps.iteration - 1);
    for (std::int64_t k = steps.iteration; k < options.iterations; k += stride) {
        ScheduleMoment moment = moment_at(options, k);
        moment.before = last.position;
        if (growth.strategy == Strategy::kMcmc && window.due(moment))
            count = std::max(count, std::min(double(cap), McmcParams{}.growth * count));
        total += cost(moment, count) * double(std::min(stride, options.iterations - k));
        last = moment;
    }
    return steps.seconds_per_iteration * total / measured_cost;
}

LongTrainingWarning::LongTrainingWarning(const TrainOptions& options, double pixels, std::int64_t cap,
                                         std::int64_t iteration, double train_seconds)
    : length_(options),
      growth_(options),
      pixels_(pixels),
      cap_(cap),
      first_iteration_(iteration),
      first_seconds_(train_seconds),
      done_(!options.ends_by_iterations() || uses_cuda(options.device)) {}

void LongTrainingWarning::update(std::int64_t iteration, double train_seconds, std::int64_t num_gaussians) {
    const double measured = train_seconds - first_seconds_;
    if (done_ || measured < kMeasuredSeconds) return;
    done_ = true;
    const std::int64_t iterations = iteration - first_iteration_;
    const double seconds = estimate_seconds(length_, growth_,
                                            {.iteration = iteration,
                                             .seconds_per_iteration = measured / double(iterations),
                                             .num_gaussians = num_gaussians,
                                             .pixels = pixels_},
                                            cap_);
    if (seconds < kLongTraining) return;
    log_warning(
        "this training takes about {} on the CPU, by the speed of its first {} iterations and the growth to come; "
        "--time-limit 10m, -r 4, or smaller --iterations and --cap-max shorten it",
        duration_text(seconds), iterations);
}

}  // namespace gs
