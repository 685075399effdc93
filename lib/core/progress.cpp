// SPDX-License-Identifier: Apache-2.0
// Shows the progress of a run as a bar, as messages or as JSON lines.
#include "lib/core/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>

#include "kernels/base/clock.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"

namespace gs {
namespace {

constexpr double kBarInterval = 0.1;     // seconds; fast enough to look alive
constexpr double kJsonInterval = 1.0;    // seconds; a day of training stays below 90 000 lines
constexpr double kPlainInterval = 5.0;   // seconds; a short training needs no lines
constexpr double kLongestSilence = 600;  // seconds; some services end a job without output for longer

std::string clock_text(double seconds) {
    const auto s = static_cast<std::int64_t>(std::lround(seconds));
    if (s >= 3600) return fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
    return fmt::format("{}:{:02}", s / 60, s % 60);
}

int terminal_columns() {
    winsize size{};
    return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

}  // namespace

ProgressStyle progress_style(bool quiet, bool json) {
    const ProgressStyle people = quiet                          ? ProgressStyle::kSilent
                                 : ::isatty(STDERR_FILENO) != 0 ? ProgressStyle::kBar
                                                                : ProgressStyle::kPlainLines;
    return json ? people | ProgressStyle::kJsonLines : people;
}

std::string fitting_line(const std::vector<std::string>& parts, int columns) {
    const auto most = std::size_t(std::max(columns, 1));
    std::string line;
    for (const std::string& part : parts) {
        const std::string gap = line.empty() ? "" : "  ";
        if (!line.empty() && line.size() + gap.size() + part.size() > most) break;
        line += gap + part;
    }
    return line.substr(0, most);
}

Progress::Progress(ProgressStyle style) : Progress(style, std::cerr, std::cout, kBarInterval, 0) {
    plain_.interval = kPlainInterval;
    json_.interval = kJsonInterval;
}

Progress::Progress(ProgressStyle style, std::ostream& bar, std::ostream& json, double seconds_between_lines,
                   int columns)
    : bar_{has(style, ProgressStyle::kBar), seconds_between_lines},
      plain_{has(style, ProgressStyle::kPlainLines), seconds_between_lines},
      json_{has(style, ProgressStyle::kJsonLines), seconds_between_lines},
      bar_stream_(bar),
      json_stream_(json),
      columns_(columns) {}

void Progress::start(std::int64_t total, std::int64_t done, const std::string& stage) {
    stage_ = stage;
    expect(total);
    rated_iteration_ = bar_.shown_iteration = plain_.shown_iteration = json_.shown_iteration = done;
    start_time_ = rated_time_ = bar_.shown_time = plain_.shown_time = json_.shown_time = seconds_now();
    shown_tenths_ = tenths(done);
    rate_ = 0;
}

void Progress::expect_end_in(double seconds) {
    total_ = 0;
    end_ = seconds_now() + seconds;
}

std::optional<double> Progress::eta_seconds(std::int64_t iteration) const {
    if (end_) return std::max(0.0, *end_ - seconds_now());
    if (total_ == 0 || rate_ == 0) return std::nullopt;
    return double(total_ - iteration) / rate_;
}

int Progress::tenths(std::int64_t iteration) const {
    double share = 0;
    if (total_ > 0) {
        share = double(iteration) / double(total_);
    } else if (end_) {
        const double gone = seconds_now() - start_time_;
        share = gone / std::max(gone, *end_ - start_time_);
    }
    return std::isfinite(share) ? int(10 * share) : 0;
}

bool Progress::due(const Outlet& outlet, std::int64_t iteration) const {
    if (!outlet.open || iteration <= outlet.shown_iteration) return false;
    return iteration == total_ || seconds_now() - outlet.shown_time >= outlet.interval;
}

/// Returns whether a plain line is due. The last iteration gets no line, because the following messages report the end.
bool Progress::plain_line_due(std::int64_t iteration) const {
    if (!due(plain_, iteration) || iteration == total_) return false;
    return tenths(iteration) > shown_tenths_ || seconds_now() - plain_.shown_time >= kLongestSilence;
}

bool Progress::due(std::int64_t iteration) const {
    return due(bar_, iteration) || due(json_, iteration) || plain_line_due(iteration);
}

void Progress::update(std::int64_t iteration, double loss, std::int64_t num_gaussians) {
    const bool bar = due(bar_, iteration), plain = plain_line_due(iteration), json = due(json_, iteration);
    if (!bar && !plain && !json) return;
    const double now = seconds_now(), seconds = now - rated_time_;
    if (seconds > 0 && iteration > rated_iteration_) {
        const double latest = double(iteration - rated_iteration_) / seconds;
        // The rate is smoothed over a few lines, because iterations get slower as the model grows and vary between
        // views.
        rate_ = rate_ == 0 ? latest : 0.7 * rate_ + 0.3 * latest;
    }
    rated_iteration_ = iteration;
    rated_time_ = now;
    if (bar) {
        bar_.shown_iteration = iteration, bar_.shown_time = now;
        draw(parts(iteration, loss, num_gaussians));
    }
    if (plain) {
        plain_.shown_iteration = iteration, plain_.shown_time = now, shown_tenths_ = tenths(iteration);
        log_info("{}", fmt::join(parts(iteration, loss, num_gaussians), "  "));
    }
    if (json) {
        json_.shown_iteration = iteration, json_.shown_time = now;
        show_json(iteration, loss, num_gaussians);
    }
}

void Progress::draw(const std::vector<std::string>& parts) {
    // The last column stays free, because some terminals wrap after a full line.
    const int columns = columns_ > 0 ? columns_ : terminal_columns();
    bar_stream_ << "\r\033[K" << fitting_line(parts, columns - 1) << std::flush;
    bar_open_ = true;
}

std::vector<std::string> Progress::parts(std::int64_t iteration, double loss, std::int64_t num_gaussians) const {
    const std::string count =
        total_ == 0 ? fmt::format("{} iterations", iteration)
                    : fmt::format("{}/{} {:3.0f}%", iteration, total_, 100.0 * double(iteration) / double(total_));
    const std::optional<double> eta = eta_seconds(iteration);
    return {(stage_.empty() ? "" : stage_ + " ") + count, fmt::format("ETA {}", eta ? clock_text(*eta) : "-"),
            fmt::format("loss {:.4f}", loss), fmt::format("{} Gaussians", num_gaussians),
            fmt::format("{:.1f} it/s", rate_)};
}

void Progress::show_json(std::int64_t iteration, double loss, std::int64_t num_gaussians) {
    nlohmann::ordered_json line = {{"event", "progress"}, {"iteration", iteration}, {"iterations", nullptr}};
    if (total_ > 0) line["iterations"] = total_;
    line["loss"] = finite_or_null(loss);
    line["num_gaussians"] = num_gaussians;
    line["iterations_per_second"] = rate_ > 0 ? finite_or_null(rate_) : nullptr;
    const std::optional<double> eta = eta_seconds(iteration);
    line["eta_seconds"] = eta ? finite_or_null(*eta) : nullptr;
    if (!stage_.empty()) line["stage"] = stage_;
    json_stream_ << json_text(line) << std::endl;
}

void Progress::count(const std::string& what, std::int64_t done, std::int64_t total) {
    const double now = seconds_now();
    for (Outlet* outlet : {&bar_, &json_}) {
        if (outlet->shown_time == 0) outlet->shown_time = now;
        if (!outlet->open || now - outlet->shown_time < outlet->interval) continue;
        outlet->shown_time = now;
        if (outlet == &bar_)
            draw({fmt::format("{} {}/{}", what, done, total)});
        else
            event({{"event", "count"}, {"what", what}, {"done", done}, {"total", total}});
    }
}

void Progress::event(const nlohmann::ordered_json& line) {
    if (json_.open) json_stream_ << json_text(line) << std::endl;
}

void Progress::finish() {
    if (bar_open_) bar_stream_ << std::endl;
    bar_open_ = false;
}

}  // namespace gs
