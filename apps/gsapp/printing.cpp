// SPDX-License-Identifier: Apache-2.0
// Chooses the table style from the type of stdout, adds the options that commands share, and assembles the report of
// `gsapp --version`.
#include "apps/gsapp/printing.h"

#include <unistd.h>

#include <cstdio>

#include "kernels/cuda/cuda_device.h"
#include "lib/core/cpu_features.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/version.h"

namespace gs {

TableStyle stdout_style() { return ::isatty(STDOUT_FILENO) != 0 ? TableStyle::kTerminal : TableStyle::kMarkdown; }

void add_json_flag(CLI::App& command, bool& json) {
    command.add_flag("--json", json, "Print all figures as JSON instead of tables");
}

void add_outcome_flag(CLI::App& command, bool& json) {
    command.add_flag("--json", json, "Print what was written, and its figures, as JSON");
}

void print_json(const nlohmann::ordered_json& json) { std::fputs((json_text(json, 1) + "\n").c_str(), stdout); }

CLI::Option* add_quiet_flag(CLI::App& command) {
    return command.add_flag_callback(
        "-q,--quiet", [] { setup_log(LogLevel::kWarn); }, "No messages below warnings");
}

std::string version_report() {
    std::string text = version_text();
    const std::string no_cuda = try_cuda_device();
    if (no_cuda.empty())
        text += "\nbackends: cpu, cuda\ndevice: " + cuda_driver_description();
    else
        text += "\nbackends: cpu (cuda: " + no_cuda + ")";
    const std::string architectures = cuda_architectures();
    return architectures.empty() ? text : text + "\ncuda architectures: " + architectures;
}

nlohmann::ordered_json version_json() {
    nlohmann::ordered_json json = {{"version", version()},
                                   {"git_hash", git_hash()},
                                   {"cpu_architecture", cpu_architecture()},
                                   {"cpu_features", built_cpu_features()},
                                   {"cuda_architectures", cuda_architectures()},
                                   {"backends", {"cpu"}}};
    const std::string no_cuda = try_cuda_device();
    if (no_cuda.empty()) {
        json["backends"].push_back("cuda");
        json["device"] = cuda_driver_description();
    } else {
        json["no_cuda"] = no_cuda;
    }
    return json;
}

}  // namespace gs
