// SPDX-License-Identifier: Apache-2.0
// Shows the progress of a run as a bar or as JSON lines.
#include "lib/core/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>

#include "kernels/core/clock.h"
#include "lib/core/json_text.h"

namespace gs {
namespace {

constexpr double kBarInterval = 0.1;   // seconds; fast enough to look alive
constexpr double kLineInterval = 1.0;  // seconds; a day of training stays below 90 000 lines

std::string clock_text(double seconds) {
    const auto s = static_cast<std::int64_t>(std::lround(seconds));
    if (s >= 3600) return fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
    return fmt::format("{}:{:02}", s / 60, s % 60);
}

nlohmann::ordered_json finite_or_null(double value) {
    if (!std::isfinite(value)) return nullptr;
    return value;
}

}  // namespace

ProgressStyle default_progress_style() {
    return ::isatty(STDERR_FILENO) != 0 ? ProgressStyle::kBar : ProgressStyle::kJsonLines;
}

Progress::Progress(ProgressStyle style)
    : Progress(style, std::cerr, std::cout, style == ProgressStyle::kBar ? kBarInterval : kLineInterval) {}

Progress::Progress(ProgressStyle style, std::ostream& bar, std::ostream& lines, double seconds_between_lines)
    : style_(style), bar_(bar), lines_(lines), interval_(seconds_between_lines) {}

void Progress::start(std::int64_t total, std::int64_t done, const std::string& stage) {
    stage_ = stage;
    total_ = total;
    shown_iteration_ = done;
    shown_time_ = seconds_now();
    rate_ = 0;
}

bool Progress::due(std::int64_t iteration) const {
    if (style_ == ProgressStyle::kSilent || iteration <= shown_iteration_) return false;
    return iteration == total_ || seconds_now() - shown_time_ >= interval_;
}

void Progress::update(std::int64_t iteration, double loss, std::int64_t num_gaussians) {
    if (!due(iteration)) return;
    const double now = seconds_now(), seconds = now - shown_time_;
    if (seconds > 0) {
        const double latest = double(iteration - shown_iteration_) / seconds;
        // Smoothed over a few lines, because iterations get slower as the model grows and single ones differ by view.
        rate_ = rate_ == 0 ? latest : 0.7 * rate_ + 0.3 * latest;
    }
    shown_iteration_ = iteration;
    shown_time_ = now;
    if (style_ == ProgressStyle::kBar)
        show_bar(iteration, loss, num_gaussians);
    else
        show_line(iteration, loss, num_gaussians);
}

void Progress::show_bar(std::int64_t iteration, double loss, std::int64_t num_gaussians) {
    bar_ << fmt::format("\r\033[K{}{}/{} {:3.0f}%  loss {:.4f}  {} Gaussians  {:.1f} it/s  ETA {}",
                        stage_.empty() ? "" : stage_ + " ", iteration, total_,
                        100.0 * double(iteration) / double(total_), loss, num_gaussians, rate_,
                        rate_ > 0 ? clock_text(eta_seconds(iteration)) : "-")
         << std::flush;
    bar_open_ = true;
}

void Progress::show_line(std::int64_t iteration, double loss, std::int64_t num_gaussians) {
    nlohmann::ordered_json line = {{"event", "progress"}, {"iteration", iteration}, {"iterations", total_}};
    line["loss"] = finite_or_null(loss);
    line["num_gaussians"] = num_gaussians;
    line["iterations_per_second"] = rate_ > 0 ? finite_or_null(rate_) : nullptr;
    line["eta_seconds"] = rate_ > 0 ? finite_or_null(eta_seconds(iteration)) : nullptr;
    if (!stage_.empty()) line["stage"] = stage_;
    lines_ << json_text(line) << std::endl;
}

void Progress::count(const std::string& what, std::int64_t done, std::int64_t total) {
    const double now = seconds_now();
    if (shown_time_ == 0) shown_time_ = now;
    if (style_ == ProgressStyle::kSilent || now - shown_time_ < interval_) return;
    shown_time_ = now;
    if (style_ == ProgressStyle::kBar) {
        bar_ << fmt::format("\r\033[K{} {}/{}", what, done, total) << std::flush;
        bar_open_ = true;
    } else {
        event({{"event", "count"}, {"what", what}, {"done", done}, {"total", total}});
    }
}

void Progress::event(const nlohmann::ordered_json& line) {
    if (style_ == ProgressStyle::kJsonLines) lines_ << json_text(line) << std::endl;
}

void Progress::finish() {
    if (bar_open_) bar_ << std::endl;
    bar_open_ = false;
}

}  // namespace gs
