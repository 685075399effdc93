// SPDX-License-Identifier: Apache-2.0
// Shows the progress of a run: one changing line on a terminal, JSON lines for programs, nothing when quiet.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace gs {

enum class ProgressStyle { kSilent, kBar, kJsonLines, kBarAndJsonLines };

inline bool has_bar(ProgressStyle style) {
    return style == ProgressStyle::kBar || style == ProgressStyle::kBarAndJsonLines;
}
inline bool has_json_lines(ProgressStyle style) {
    return style == ProgressStyle::kJsonLines || style == ProgressStyle::kBarAndJsonLines;
}

/// Returns JSON lines where stdout is no terminal or `json` asks for them, and the bar where stderr is a terminal.
/// With `quiet` there is no bar, and no JSON lines but those that `json` asks for.
ProgressStyle progress_style(bool quiet, bool json);

/// Joins as many of `parts`, the first ones, as fit on a line of `columns` characters; cuts the first if it must.
std::string fitting_line(const std::vector<std::string>& parts, int columns);

/// Shows iteration, loss, number of Gaussians, speed and remaining time.
///
/// The bar goes to stderr, at most ten times a second, and never takes more than one line of the terminal. JSON lines
/// go to stdout, at most one a second besides the last:
///   {"event":"progress","iteration":700,"iterations":30000,"loss":0.0812,"num_gaussians":94477,
///    "iterations_per_second":21.4,"eta_seconds":1369.2}
/// `loss` is null when it is not finite; the total, speed and ETA are null while they are not known.
class Progress {
  public:
    explicit Progress(ProgressStyle style);
    /// For tests: other streams, another minimum time between two lines, and a terminal of `columns` characters.
    Progress(ProgressStyle style, std::ostream& bar, std::ostream& lines, double seconds_between_lines,
             int columns = 200);

    ProgressStyle style() const { return style_; }

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
    /// One of the two ways to show progress.
    struct Outlet {
        bool open;
        std::ostream& stream;
        double interval;  ///< seconds between two lines
        std::int64_t shown_iteration = 0;
        double shown_time = 0;
    };
    bool due(const Outlet& outlet, std::int64_t iteration) const;
    void draw(const std::vector<std::string>& parts);
    void show_bar(std::int64_t iteration, double loss, std::int64_t num_gaussians);
    void show_line(std::int64_t iteration, double loss, std::int64_t num_gaussians);
    /// Returns the seconds that are left after `iteration`; empty while they are not known.
    std::optional<double> eta_seconds(std::int64_t iteration) const;

    ProgressStyle style_;
    Outlet bar_, lines_;
    int columns_;  ///< 0 = those of the terminal
    std::string stage_;
    std::int64_t total_ = 0;            ///< 0 = not known
    std::optional<double> end_ = {};    ///< the time at which the count ends, where time decides
    std::int64_t rated_iteration_ = 0;  ///< the last one shown, from which the speed counts
    double rated_time_ = 0;
    double rate_ = 0;        ///< iterations per second, smoothed; 0 = not known yet
    bool bar_open_ = false;  ///< the cursor is at the end of a bar
};

}  // namespace gs
