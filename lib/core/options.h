// SPDX-License-Identifier: Apache-2.0
// The table of options: one table describes every field of TrainOptions, and all code that reads, writes, checks or
// documents options iterates over it.
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

/// The place where an option is stored; the alternative determines its type.
template <class... T> using FieldOf = std::variant<T TrainOptions::*..., ModelOptionField>;
using OptionField =
    FieldOf<std::string, bool, int, std::optional<int>, std::int64_t, std::optional<std::int64_t>, std::uint64_t,
            double, std::optional<double>, std::optional<Duration>, ByteCount, std::optional<ByteCount>,
            std::vector<std::int64_t>, Background, ScheduleKind, GrowthBy, Recipe, Preset, SizeOf, Strategy, Device,
            PpispMode, VerifyImages, MaskMode, LensMode, AlphaMode, Antialiasing, RefineCameras, AppearanceStorage,
            AppearanceMoments, Movers, ColorActivation>;

/// Returns the value of `field` in `options`.
template <class T> const T& option_value(const TrainOptions& options, T TrainOptions::*field) { return options.*field; }
template <class T> T& option_value(TrainOptions& options, T TrainOptions::*field) { return options.*field; }
inline const std::optional<double>& option_value(const TrainOptions& options, const ModelOptionField& field) {
    return options.model_options.at(field.key);
}
inline std::optional<double>& option_value(TrainOptions& options, const ModelOptionField& field) {
    return options.model_options.at(field.key);
}

/// The scope of an option, which determines where its values must be equal.
enum class Scope {
    kExperiment,  ///< affects the result of a training: equal in all runs of an experiment unless it is an axis
    kScene,       ///< selects the training and test images, or the device: equal in all runs, never an axis
    kRun,         ///< may differ between runs of one experiment: the seed, or the output
    kMachine,     ///< concerns one machine and changes no bit of the model: may differ between ranks
    kCall,        ///< applies to one call: a resumed run does not inherit it
};

/// One option. Its default is its value in a default-constructed TrainOptions.
struct Option {
    std::string key;  ///< kebab-case; the YAML key, and `--key` on the command line
    OptionField field;
    std::string group = {};                    ///< heading of its group in help, files and docs
    std::string help;                          ///< description, one sentence
    std::string unit = {};                     ///< unit of the value; empty for pure numbers and words
    std::optional<double> min = {}, max = {};  ///< inclusive limits of a number, or of each element of a list
    std::string unset_word = {};               ///< for optional values: text of an empty value
    std::string max_word = {};                 ///< for numbers: word for the largest value
    std::vector<std::string> choices = {};     ///< allowed words; empty = see `values`
    std::string values = {};                   ///< allowed values in words, if neither range nor choices describe them
    std::vector<std::string> names = {};       ///< further spellings shown in the help ("-s", "--output")
    std::string implicit = {};                 ///< value when the flag stands alone; empty = the flag needs a value
    bool is_basic = false;                     ///< shown in the help that fits one screen
    bool is_path = false;                      ///< value is a file or folder of the user
    Scope scope = Scope::kExperiment;
    std::string measured = {};  ///< measured effect, for docs/options.md; required with kExperiment
    std::string frontier = {};  ///< value that recipe frontier uses instead of the default; empty = the default
};

/// Returns all options, grouped.
const std::vector<Option>& train_option_table();

/// Returns the headings in the order of the table.
std::vector<std::string> option_groups();

/// Returns the allowed values of an option in words: "1..8", "0..10 or auto", "relu, softplus", ...
std::string option_range(const Option& option);

/// Returns the value of `option` in `options` as text for YAML and help ("true", "0.2", "[7000, 30000]").
std::string option_text(const Option& option, const TrainOptions& options);

/// Parses `values` (one text, or the elements of a list) into the field of `option`, and adds its key to options.named.
/// `where` is the place for error messages ("--cap-max", "bonsai.yaml:3: cap-max"). Throws UsageError for a text of the
/// wrong type; resolve() checks ranges.
void set_option(TrainOptions& options, const Option& option, const std::vector<std::string>& values,
                const std::string& where);

/// Checks the value of `option` against the table and the rules of the option. Throws UsageError naming option, value
/// and range.
void check_option(const Option& option, const TrainOptions& options);

/// Returns the lowest level of the messages that are shown.
LogLevel shown_messages(const OutputOptions& options);

/// Returns the complete options of a run. Checks every value against the table and the rules between options, sets
/// options that were not named to the values of preset, recipe and strategy, and fills in dependent values. Throws
/// UsageError naming option, value and range.
TrainOptions resolve(TrainOptions options);

/// Sets the iterations of the preset, unless they were named. Throws UsageError if there is a time limit as well.
void apply_preset(TrainOptions& options);

/// The largest number of Gaussians for built-in scenes, unless cap-max is named. Their training images have 768,000
/// pixels in total.
inline constexpr std::int64_t kBuiltinCap = 100000;

/// Sets cap-max to kBuiltinCap if it was not named and the scene is built-in.
void apply_builtin_cap(TrainOptions& options);

/// Returns whether the scene is built-in and cap-max was not named.
bool has_builtin_cap(const TrainOptions& options);

/// Returns the options that keep another value than recipe frontier's because they were named, e.g. "opacity-reg 0.01".
/// `options` must be resolved.
std::vector<std::string> kept_from_recipe(const TrainOptions& options);

/// Returns the defaults overridden by the file, after its `parent:` (relative to the file). The rules between options
/// are not checked, because the command line may still add missing parts. Throws UsageError naming file, line and key
/// for a value out of range, for a repeated key, and for an unknown key, with the nearest known key.
TrainOptions load_options_yaml(const std::filesystem::path& path);

/// Returns YAML with every option and its value, grouped by headings, after a comment naming the program.
/// load_options_yaml restores equal options from it.
std::string options_to_yaml(const TrainOptions& options);

/// Loads the options of a run: config.yaml in its folder. Missing files are sought at their old location relative to
/// the run folder, since run and files may have moved together (lib/core/run_config.h). Throws DataError if there is no
/// config.yaml.
TrainOptions load_run_options(const std::filesystem::path& run_folder);

/// Returns the text of docs/options.md.
std::string options_markdown();

}  // namespace gs
