// SPDX-License-Identifier: Apache-2.0
// Converts events to lines of JSON.
#include "lib/train/journal.h"

#include <algorithm>
#include <utility>

#include "lib/core/log.h"

namespace gs {

void Journal::open() {
    check_folder();
    log_.emplace(folder_.train_log(), 0, false);
}

void Journal::resume(std::int64_t iteration, bool at_end) {
    check_folder();
    log_.emplace(folder_.train_log(), iteration, at_end);
    if (tensorboard_) tensorboard_->resume(iteration);
}

void Journal::write(nlohmann::json line) {
    check_folder();  // otherwise the lines would go to a file that is no longer in any folder
    if (lines_are_final_) line["final"] = true;
    log_->write(line);
    if (tensorboard_) tensorboard_->add_line(line);
}

void Journal::write_step(const StepLine& line, std::int64_t iteration) {
    write({{"event", "step"},
           {"iteration", iteration},
           {"loss", line.stats.loss},
           {"l1", line.stats.l1},
           {"ssim", line.stats.ssim},
           {"num_gaussians", line.num_gaussians},
           {"num_instances", line.stats.num_instances},
           {"active_degree", line.active_degree},
           {"milliseconds", 1e3 * line.seconds},
           {"data_wait_milliseconds",
            1e3 * (line.data_wait_seconds - std::exchange(earlier_wait_, line.data_wait_seconds))},
           {"train_seconds", line.train_seconds}});
    if (tensorboard_) tensorboard_->add_rates(iteration, line.rates);
}

void Journal::write_change(const ScheduledChange& change, std::int64_t iteration) {
    if (change.relocated || change.added || change.cloned || change.split || change.pruned)
        write({{"event", "densify"},
               {"iteration", iteration},
               {"relocated", change.relocated},
               {"added", change.added},
               {"cloned", change.cloned},
               {"split", change.split},
               {"pruned", change.pruned},
               {"num_gaussians", change.count + change.pruned_by_score}});
    if (change.pruned_by_score)
        write({{"event", "prune_by_score"},
               {"iteration", iteration},
               {"pruned", change.pruned_by_score},
               {"num_gaussians", change.count}});
}

void Journal::write_residuals(const ResidualChange& change, std::int64_t num_gaussians, std::int64_t iteration) {
    log_info("iteration {}: {} of {} Gaussians keep a colour that depends on the view ({:.1f} %)", iteration,
             change.after, num_gaussians,
             100 * double(change.after) / double(std::max<std::int64_t>(1, num_gaussians)));
    write({{"event", "residuals"},
           {"iteration", iteration},
           {"pruned", change.pruned},
           {"before", change.before},
           {"after", change.after},
           {"num_gaussians", num_gaussians},
           {"loss_dB", change.loss}});
}

void Journal::write_nonfinite(std::int64_t removed, const std::string& parameters, std::int64_t iteration) {
    log_warning("iteration {}: removed {} Gaussians with parameters that are not finite or out of range ({})",
                iteration, removed, parameters);
    write({{"event", "prune_nonfinite"}, {"iteration", iteration}, {"removed", removed}, {"parameters", parameters}});
}

void Journal::write_evaluation(const TestScores& scores, std::int64_t iteration) {
    write({{"event", "evaluation"},
           {"iteration", iteration},
           {"psnr", scores.psnr},
           {"ssim", scores.ssim},
           {"views", scores.views}});
}

void Journal::write_target(const MeasuredModel& measured) {
    log_info("iteration {}: {} Gaussians, {:.2f} dB on the held-out views", measured.steps, measured.count,
             measured.psnr);
    write({{"event", "target"},
           {"iteration", measured.steps},
           {"num_gaussians", measured.count},
           {"psnr", measured.psnr}});
}

}  // namespace gs
