// SPDX-License-Identifier: Apache-2.0
// Shows the progress of a run: one changing line on a terminal, a few plain ones elsewhere, JSON lines for programs.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace gs {

/// The ways to show progress, which `|` combines.
enum class ProgressStyle : unsigned { kSilent = 0, kBar = 1, kPlainLines = 2, kJsonLines = 4 };

constexpr ProgressStyle operator|(ProgressStyle a, ProgressStyle b) { return ProgressStyle(unsigned(a) | unsigned(b)); }
constexpr bool has(ProgressStyle style, ProgressStyle part) { return (unsigned(style) & unsigned(part)) != 0; }

/// Returns what people see, which is the bar if stderr is a terminal, plain lines if it is none and nothing if `quiet`,
/// together with JSON lines if `json` asks for them.
ProgressStyle progress_style(bool quiet, bool json);

/// Joins as many of `parts`, the first ones, as fit on a line of `columns` characters; cuts the first if it must.
std::string fitting_line(const std::vector<std::string>& parts, int columns);

/// Shows iteration, loss, number of Gaussians, speed and remaining time.
///
/// The bar goes to stderr, at most ten times a second, and never takes more than one line of the terminal. Plain lines
/// are messages: one for each tenth of the count that is done, or after ten minutes, but none within five seconds of
/// the one before. JSON lines go to stdout, at most one a second besides the last:
///   {"event":"progress","iteration":700,"iterations":30000,"loss":0.0812,"num_gaussians":94477,
///    "iterations_per_second":21.4,"eta_seconds":1369.2}
/// `loss` is null when it is not finite; the total, speed and ETA are null while they are not known.
class Progress {
  public:
    explicit Progress(ProgressStyle style);
    /// For tests: other streams, another minimum time between two lines, and a terminal of `columns` characters.
    Progress(ProgressStyle style, std::ostream& bar, std::ostream& json, double seconds_between_lines,
             int columns = 200);

    /// Begins a count, before its first iteration. `done` iterations of `total` were made by an earlier run; a total of
    /// 0 is not known. `stage` names the count if it is not the training itself; JSON lines then have it as "stage".
    void start(std::int64_t total, std::int64_t done, const std::string& stage = "");

    /// Corrects the total.
    void expect(std::int64_t total) {
        total_ = total;
        end_.reset();
    }
    /// Says that the count ends in `seconds`, after a number of iterations that is not known.
    void expect_end_in(double seconds);

    /// Returns true if `update` would show something now. Ask before fetching the loss from the device.
    bool due(std::int64_t iteration) const;

    /// Shows the progress after `iteration` iterations (1-based); does nothing when not due.
    void update(std::int64_t iteration, double loss, std::int64_t num_gaussians);

    /// Shows that `done` of `total` things are done, before any training: "images decoded 120/300", or the JSON line
    /// {"event":"count","what":"images decoded","done":120,"total":300}. Does nothing more often than `update` does.
    void count(const std::string& what, std::int64_t done, std::int64_t total);

    /// Writes an additional JSON line for programs, in which "event" names the event; other styles drop it.
    void event(const nlohmann::ordered_json& line);

    /// Ends the line of the bar. Call it before printing results.
    void finish();

  private:
    /// One of the ways to show progress.
    struct Outlet {
        bool open;
        double interval;  ///< least seconds between two lines
        std::int64_t shown_iteration = 0;
        double shown_time = 0;
    };
    bool due(const Outlet& outlet, std::int64_t iteration) const;
    bool plain_line_due(std::int64_t iteration) const;
    void draw(const std::vector<std::string>& parts);
    /// Returns the progress in words, the most important ones first.
    std::vector<std::string> parts(std::int64_t iteration, double loss, std::int64_t num_gaussians) const;
    void show_json(std::int64_t iteration, double loss, std::int64_t num_gaussians);
    /// Returns the seconds that are left after `iteration`; empty while they are not known.
    std::optional<double> eta_seconds(std::int64_t iteration) const;
    /// Returns how many tenths of the count are done; 0 while that is not known.
    int tenths(std::int64_t iteration) const;

    Outlet bar_, plain_, json_;
    std::ostream &bar_stream_, &json_stream_;
    int columns_;  ///< 0 = those of the terminal
    std::string stage_;
    std::int64_t total_ = 0;          ///< 0 = not known
    std::optional<double> end_ = {};  ///< the time at which the count ends, where time decides
    double start_time_ = 0;
    int shown_tenths_ = 0;              ///< in the last plain line
    std::int64_t rated_iteration_ = 0;  ///< the last one shown, from which the speed counts
    double rated_time_ = 0;
    double rate_ = 0;        ///< iterations per second, smoothed; 0 = not known yet
    bool bar_open_ = false;  ///< the cursor is at the end of a bar
};

}  // namespace gs
