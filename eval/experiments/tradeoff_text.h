// SPDX-License-Identifier: Apache-2.0
// Formats the values of a trade-off for readers, for its table, its text and its plots.
#pragma once

#include <string>

#include "eval/experiments/tradeoff.h"
#include "eval/pages/text_table.h"

namespace gs {

/// Formats a quality: "30.12 dB", "0.9321".
std::string quality_text(double value, Quality quality);
/// Formats a difference: "0.42 dB", "0.0130 SSIM".
std::string loss_text(double difference, Quality quality);
/// Formats a size: "4.8 MB".
std::string bytes_text(std::int64_t bytes);
/// Formats the frames per second of a result: "143.2".
std::string fps_text(const RunResult& result);

/// Returns a table of the finished runs: the frontier, then the dominated runs in grey.
TextTable tradeoff_table(const Tradeoff& tradeoff);

/// Returns the remarks, then explanations of the numbers: the mark of the frontier, the number of trainings per
/// configuration, the protocol.
std::vector<std::string> tradeoff_notes(const Tradeoff& tradeoff);

/// Returns the reason for a missing result: "failed: ...", "stopped at the time limit", ...
std::string state_text(const TradeoffRun& run);

}  // namespace gs
