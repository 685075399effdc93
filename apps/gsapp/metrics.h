// SPDX-License-Identifier: Apache-2.0
// Options about metrics that several subcommands share.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "eval/metrics/metrics.h"

namespace gs {

struct MetricArguments {
    std::string names;    ///< as for parse_metric_names
    std::string weights;  ///< as for metric_weights_folder
    std::optional<Device> device = {};
};

/// Adds --metrics, --metric-weights and --device. Their values go into `arguments`, which must outlive `command`.
void add_metric_options(CLI::App& command, MetricArguments& arguments);

/// Throws UsageError.
MetricOptions metric_options(const MetricArguments& arguments, LpipsRange lpips_range);

}  // namespace gs
