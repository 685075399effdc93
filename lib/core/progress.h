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

/// The styles of progress output; `|` combines them.
enum class ProgressStyle : unsigned { kSilent = 0, kBar = 1, kPlainLines = 2, kJsonLines = 4 };

constexpr ProgressStyle operator|(ProgressStyle a, ProgressStyle b) { return ProgressStyle(unsigned(a) | unsigned(b)); }
constexpr bool has(ProgressStyle style, ProgressStyle part) { return (unsigned(style) & unsigned(part)) != 0; }

/// Returns the style of progress output: nothing if `quiet`, else the bar if stderr is a terminal and plain lines if
/// not; with `json` also JSON lines.
ProgressStyle progress_style(bool quiet, bool json);

/// Joins as many of the first `parts` as fit on a line of `columns` characters. Truncates the first part if it is too
/// long.
std::string fitting_line(const std::vector<std::string>& parts, int columns);

/// Shows iteration, loss, number of Gaussians, speed and remaining time of a run.
///
/// The bar goes to stderr, at most ten times a second, and never takes more than one line of the terminal. Plain lines
/// are messages: one for each finished tenth of the count, or after ten minutes, but none within five seconds of the
/// previous one. JSON lines go to stdout, at most one per second except the last:
///   {"event":"progress","iteration":700,"iterations":30000,"loss":0.0812,"num_gaussians":94477,
///    "iterations_per_second":21.4,"eta_seconds":1369.2}
/// `loss` is null if it is not finite; the total, speed and ETA are null while unknown.
class Progress {
  public:
    explicit Progress(ProgressStyle style);
    /// For tests: other streams, another minimum interval between two lines, and a terminal of `columns` characters.
    Progress(ProgressStyle style, std::ostream& bar, std::ostream& json, double seconds_between_lines,
             int columns = 200);

    /// Begins a count, before its first iteration. `done` of `total` iterations were finished by an earlier run; a
    /// total of 0 means unknown. `stage` is the name of the count unless it is the training itself; JSON lines then
    /// contain it as "stage".
    void start(std::int64_t total, std::int64_t done, const std::string& stage = "");

    /// Corrects the total.
    void expect(std::int64_t total) {
        total_ = total;
        end_.reset();
    }
    /// Sets the end of the count to `seconds` from now, after an unknown number of iterations.
    void expect_end_in(double seconds);

    /// Returns whether `update` would show something now. Call it before fetching the loss from the device.
    bool due(std::int64_t iteration) const;

    /// Shows the progress after `iteration` iterations (1-based); does nothing if not due.
    void update(std::int64_t iteration, double loss, std::int64_t num_gaussians);

    /// Shows that `done` of `total` items are done, before any training: "images decoded 120/300", or the JSON line
    /// {"event":"count","what":"images decoded","done":120,"total":300}. Limited to the same rate as `update`.
    void count(const std::string& what, std::int64_t done, std::int64_t total);

    /// Writes an additional JSON line for programs, in which "event" is the name of the event; other styles ignore it.
    void event(const nlohmann::ordered_json& line);

    /// Ends the line of the bar. Call it before printing results.
    void finish();

  private:
    /// One of the outputs of progress.
    struct Outlet {
        bool open;
        double interval;  ///< minimum seconds between two lines
        std::int64_t shown_iteration = 0;
        double shown_time = 0;
    };
    bool due(const Outlet& outlet, std::int64_t iteration) const;
    bool plain_line_due(std::int64_t iteration) const;
    void draw(const std::vector<std::string>& parts);
    /// Returns the progress as parts of a line, the most important first.
    std::vector<std::string> parts(std::int64_t iteration, double loss, std::int64_t num_gaussians) const;
    void show_json(std::int64_t iteration, double loss, std::int64_t num_gaussians);
    /// Returns the remaining seconds after `iteration`; nothing while unknown.
    std::optional<double> eta_seconds(std::int64_t iteration) const;
    /// Returns the number of finished tenths of the count; 0 while unknown.
    int tenths(std::int64_t iteration) const;

    Outlet bar_, plain_, json_;
    std::ostream &bar_stream_, &json_stream_;
    int columns_;  ///< width of the line in characters; 0 = width of the terminal
    std::string stage_;
    std::int64_t total_ = 0;          ///< number of iterations; 0 = unknown
    std::optional<double> end_ = {};  ///< time at which the count ends, if it ends by time
    double start_time_ = 0;
    int shown_tenths_ = 0;              ///< tenths shown in the last plain line
    std::int64_t rated_iteration_ = 0;  ///< last shown iteration, from which the speed is measured
    double rated_time_ = 0;
    double rate_ = 0;        ///< iterations per second, smoothed; 0 = not yet known
    bool bar_open_ = false;  ///< whether the cursor is at the end of a bar
};

}  // namespace gs
