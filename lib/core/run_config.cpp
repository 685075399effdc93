// SPDX-License-Identifier: Apache-2.0
// Makes the paths of a run absolute, and restores them after a move.
#include "lib/core/run_config.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>
#include <vector>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/options.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns the options that name files and folders of the user, except the run's own folder.
std::vector<std::string TrainOptions::*> paths() {
    std::vector<std::string TrainOptions::*> fields;
    for (const Option& option : train_option_table())
        if (option.is_path) fields.push_back(std::get<std::string TrainOptions::*>(option.field));
    return fields;
}

constexpr std::string_view kBuiltin = "builtin:";

/// Returns the number of characters before the path: a built-in scene may be a file, builtin:FILE.yaml.
std::size_t prefix_length(const std::string& text) { return text.starts_with(kBuiltin) ? kBuiltin.size() : 0; }

/// Returns whether the text names a path in the file system.
bool is_path(const std::string& text) {
    const bool is_file = text.ends_with(".yaml") || text.ends_with(".yml");
    return !text.empty() && (is_file || !text.starts_with(kBuiltin));
}

/// Returns whether `path` exists. Errors are ignored here and reported when the path is read.
bool is_there(const fs::path& path) {
    std::error_code ignored;
    return fs::exists(path, ignored);
}

}  // namespace

std::string absolute_path(const std::string& text) {
    if (!is_path(text)) return text;
    const std::size_t prefix = prefix_length(text);
    std::error_code error;
    const fs::path whole = fs::absolute(text.substr(prefix), error);
    if (error || whole.empty()) return text;
    fs::path plain = whole.lexically_normal();
    if (!plain.has_filename()) plain = plain.parent_path();
    // After a symbolic link, ".." may lead to another folder than the text suggests.
    if (is_there(whole) && !fs::equivalent(whole, plain, error)) plain = whole;
    return text.substr(0, prefix) + plain.string();
}

TrainOptions with_absolute_paths(TrainOptions options) {
    for (std::string TrainOptions::*path : paths()) options.*path = absolute_path(options.*path);
    options.model = absolute_path(options.model);
    return options;
}

bool scene_exists(const std::string& source) {
    return !is_path(source) || is_there(source.substr(prefix_length(source)));
}

std::string run_config(const TrainOptions& options) { return options_to_yaml(with_absolute_paths(options)); }

TrainOptions load_run_options(const fs::path& run_folder) {
    const fs::path file = run_folder / "config.yaml";
    if (!path_exists(file)) {
        throw DataError(
            fmt::format("{} is not the output folder of a run: it has no config.yaml", run_folder.string()));
    }
    TrainOptions options = load_options_yaml(file);
    const fs::path before = options.model, now = absolute_path(run_folder.string());
    for (std::string TrainOptions::*field : paths()) {
        const std::string& text = options.*field;
        if (!is_path(text)) continue;
        const std::size_t prefix = prefix_length(text);
        const fs::path path = text.substr(prefix);
        // Older versions stored paths as given, relative to the current folder of the call.
        if (is_there(path) || !path.is_absolute() || !before.is_absolute()) continue;
        const fs::path moved = (now / path.lexically_relative(before)).lexically_normal();
        if (is_there(moved)) options.*field = text.substr(0, prefix) + moved.string();
    }
    return options;
}

}  // namespace gs
