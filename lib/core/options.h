// SPDX-License-Identifier: Apache-2.0
// Options are data: one table describes every field of TrainOptions, and everything that reads, writes, checks or
// documents options walks over that table.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "lib/core/log.h"
#include "lib/core/train_options.h"

namespace gs {

/// An option that an appearance model declares: a number in TrainOptions::model_options.
struct ModelOptionField {
    std::string key;
    bool is_whole = false;
};

/// Where an option is stored; the alternative is its type.
template <class... T> using FieldOf = std::variant<T TrainOptions::*..., ModelOptionField>;
using OptionField = FieldOf<std::string, bool, int, std::optional<int>, std::int64_t, std::optional<std::int64_t>,
                            std::uint64_t, double, std::optional<double>, std::optional<Duration>, ByteCount,
                            std::optional<ByteCount>, std::vector<std::int64_t>, Background, ScheduleKind, GrowthBy,
                            Recipe, Preset, SizeOf, Strategy, Device, PpispMode, VerifyImages, MaskMode, AlphaMode,
                            AppearanceStorage, AppearanceMoments, Movers, ColorActivation>;

/// Returns the value that `field` names in `options`.
template <class T> const T& option_value(const TrainOptions& options, T TrainOptions::*field) { return options.*field; }
template <class T> T& option_value(TrainOptions& options, T TrainOptions::*field) { return options.*field; }
inline const std::optional<double>& option_value(const TrainOptions& options, const ModelOptionField& field) {
    return options.model_options.at(field.key);
}
inline std::optional<double>& option_value(TrainOptions& options, const ModelOptionField& field) {
    return options.model_options.at(field.key);
}

/// What an option is about, from which follows where it must be equal.
enum class Scope {
    kExperiment,  ///< decides what a training makes: equal in all runs of an experiment, and may be an axis
    kScene,       ///< decides which pictures are trained on and scored, or on what device: equal, but no axis
    kRun,         ///< differs between runs of one experiment: chance, or what is written
    kMachine,     ///< concerns one machine, and changes no bit of the model: each rank may have its own
    kCall,        ///< is of one call: a run that is resumed does not take it over
};

/// One option. Its default is the value in a default-constructed TrainOptions.
struct Option {
    std::string key;  ///< kebab-case; the YAML key, and `--key` on the command line
    OptionField field;
    std::string group = {};                    ///< heading in help, files and docs
    std::string help;                          ///< what it does, one sentence
    std::string unit = {};                     ///< empty for pure numbers and words
    std::optional<double> min = {}, max = {};  ///< limits of numbers, inclusive; of a list, those of each element
    std::string unset_word = {};               ///< for optional values: the text of an empty one
    std::string max_word = {};                 ///< for numbers: a word for the largest one
    std::vector<std::string> choices = {};     ///< allowed words; empty = see `values`
    std::string values = {};                   ///< allowed values in words, where neither range nor choices say it
    std::vector<std::string> names = {};       ///< further spellings shown in the help ("-s", "--output")
    std::string implicit = {};                 ///< value when the flag stands alone; empty = the flag needs a value
    bool is_basic = false;                     ///< stands in the help that fits one screen
    bool is_path = false;                      ///< names a file or folder of the user
    Scope scope = Scope::kExperiment;
    std::string measured = {};  ///< what it gives, for docs/options.md; every option of an experiment says it
    std::string frontier = {};  ///< the value that recipe frontier puts in place of the default; empty = none
};

/// All options, grouped.
const std::vector<Option>& train_option_table();

/// The headings in the order of the table.
std::vector<std::string> option_groups();

/// Returns the allowed values of an option in words: "1..8", "0..10 or auto", "relu, softplus", ...
std::string option_range(const Option& option);

/// The value of `option` in `options` as it is written in YAML and shown in help ("true", "0.2", "[7000, 30000]").
std::string option_text(const Option& option, const TrainOptions& options);

/// Parses `values` (one text, or the elements of a list) into the field. `where` names the place in error messages
/// ("--cap-max", "bonsai.yaml:3: cap-max"), and notes that it was named. Throws UsageError for a text of the wrong
/// type; ranges are left to resolve.
void set_option(TrainOptions& options, const Option& option, const std::vector<std::string>& values,
                const std::string& where);

/// Checks one value against the table and the rules of its option. Throws UsageError naming option, value and range.
void check_option(const Option& option, const TrainOptions& options);

/// Returns the least important messages that are shown.
LogLevel shown_messages(const OutputOptions& options);

/// Returns the options of a run: every value checked against the table and the few rules between options, those that
/// were not named at the values of preset, recipe and strategy, and what follows from others filled in. Throws
/// UsageError naming option, value and range.
TrainOptions resolve(TrainOptions options);

/// Puts the iterations of a preset in place, unless they were named. Throws UsageError beside a time limit.
void apply_preset(TrainOptions& options);

/// The largest number of Gaussians of built-in scenes unless cap-max is named. Their training images have 768,000
/// pixels together.
inline constexpr std::int64_t kBuiltinCap = 100000;

/// Puts kBuiltinCap in place of a cap-max that was not named, if the scene is a built-in one.
void apply_builtin_cap(TrainOptions& options);

/// Returns whether the scene is a built-in one and cap-max was not named.
bool has_builtin_cap(const TrainOptions& options);

/// Returns the options that recipe frontier leaves at another value because they were named, e.g. "opacity-reg 0.01".
/// `options` must be resolved.
std::vector<std::string> kept_from_recipe(const TrainOptions& options);

/// Returns the defaults overlaid with the file, its `parent:` (relative to the file) first. The rules between options
/// are not checked: the command line may still add the missing parts. Throws UsageError naming file, line and key for a
/// value out of range, for a key that stands twice, and for an unknown key, with the nearest known one.
TrainOptions load_options_yaml(const std::filesystem::path& path);

/// Every option with its value, grouped by headings, after a comment naming the program; load_options_yaml reads it
/// back to equal options.
std::string options_to_yaml(const TrainOptions& options);

/// Loads the options of a run: config.yaml in its folder. Files that are gone are looked for where they were relative
/// to the run, which may have moved with them (lib/core/run_config.h). Throws DataError if there is no config.yaml.
TrainOptions load_run_options(const std::filesystem::path& run_folder);

/// Returns the text of docs/options.md.
std::string options_markdown();

}  // namespace gs
