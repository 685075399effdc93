// SPDX-License-Identifier: Apache-2.0
// Registers the table of options with CLI11 and reads the given values back.
#include "lib/core/options_cli.h"

#include <algorithm>

#include <fmt/format.h>

#include "kernels/core/error.h"
#include "lib/core/input_file.h"

namespace gs {
namespace {

const char* type_word(const Option& option) {
    if (const auto* of_model = std::get_if<ModelOptionField>(&option.field))
        return of_model->is_whole ? "INTEGER" : "NUMBER";
    return std::visit(
        [](const auto& field) {
            using T = std::decay_t<decltype(option_value(TrainOptions{}, field))>;
            if constexpr (std::is_same_v<T, double>) return "NUMBER";
            if constexpr (std::is_integral_v<T> || std::is_same_v<T, std::vector<std::int64_t>>) return "INTEGER";
            return "TEXT";
        },
        option.field);
}

bool is_switch(const Option& option) { return std::holds_alternative<bool TrainOptions::*>(option.field); }
bool is_list_option(const Option& option) {
    return std::holds_alternative<std::vector<std::int64_t> TrainOptions::*>(option.field);
}

std::string help_text(const Option& option) {
    if (is_switch(option)) return option.help;
    std::string range = option_range(option);
    if (!option.unit.empty()) range += " " + option.unit;
    return fmt::format("{} ({})", option.help, range);
}

std::vector<std::string> hidden_spellings(const Option& option) {
    std::vector<std::string> names = option.hidden_names;
    std::string underscores = "--" + option.key;
    std::replace(underscores.begin() + 2, underscores.end(), '-', '_');
    if (underscores != "--" + option.key) names.push_back(underscores);
    return names;
}

}  // namespace

CLI::Option* TrainArguments::declare_spelling(CLI::App& app, const Option& option, const std::string& names) {
    CLI::Option* cli = nullptr;
    const std::string help = help_text(option);
    if (is_switch(option)) {
        cli = app.add_flag(names, help);
    } else {
        // Values are read back as text in `resolve`, so that file and command line share one parser.
        cli = app.add_option(
            names, [](const CLI::results_t&) { return true; }, help);
        cli->type_name(type_word(option));
        if (is_list_option(option))
            cli->expected(CLI::detail::expected_max_vector_size);
        else if (!option.implicit.empty())
            cli->expected(0, 1)->default_str(option.implicit);
        else
            cli->expected(1);
    }
    // The last of repeated flags counts, as in 3DGS, whose scripts should run unchanged.
    if (!is_list_option(option)) cli->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
    flags_.push_back({&option, cli});
    return cli;
}

void TrainArguments::declare(CLI::App& app, const Option& option) {
    std::string names = fmt::format("{}", fmt::join(option.names, ","));
    names += (names.empty() ? "--" : ",--") + option.key;
    if (option.key == "source") names += ",scene";
    CLI::Option* visible = declare_spelling(app, option, names)->group(option.group);
    const std::string default_text = option_text(option, TrainOptions{});
    if (!is_switch(option) && option.implicit.empty() && default_text != "[]") visible->default_str(default_text);
    if (const auto hidden = hidden_spellings(option); !hidden.empty()) {
        declare_spelling(app, option, fmt::format("{}", fmt::join(hidden, ",")))->group("");
    }
}

TrainArguments::TrainArguments(CLI::App& app, const std::string& without) {
    app.add_option("-c,--config", config_, "YAML file with options; flags override it")->type_name("FILE");
    for (const Option& option : train_option_table())
        if (option.key != without) declare(app, option);
    const std::string white_help = "short for --background white; overrides --background";
    white_.push_back(app.add_flag("-w,--white-background", white_help)->group("Run"));
    white_.push_back(app.add_flag("--white_background", white_help)->group(""));
}

void TrainArguments::apply_flags(TrainOptions& options) const {
    const Option* previous = nullptr;
    for (const Flag& flag : flags_) {
        if (flag.cli->count() == 0) continue;
        if (flag.option == previous)
            throw UsageError(fmt::format("option {} is given twice, in two spellings", flag.option->key));
        previous = flag.option;
        if (is_switch(*flag.option)) {
            options.*std::get<bool TrainOptions::*>(flag.option->field) = flag.cli->as<bool>();
        } else {
            set_option(options, *flag.option, flag.cli->reduced_results(), "--" + flag.option->key);
        }
    }
    const bool white = std::any_of(white_.begin(), white_.end(), [](const CLI::Option* o) { return o->count() > 0; });
    if (white) options.background = Background::white();
}

TrainOptions TrainArguments::base(bool stored_run) const {
    if (!config_.empty()) return load_options_yaml(config_);
    TrainOptions flags_only;
    apply_flags(flags_only);
    const std::filesystem::path run = flags_only.model;
    const bool wanted = !flags_only.resume.empty() || (stored_run && !run.empty());
    if (!wanted || !path_exists(run / "config.yaml")) return {};
    TrainOptions options = load_run_options(run);
    options.overwrite = false;  // these two belong to one call of the program, not to the run
    options.resume.clear();
    return options;
}

TrainOptions TrainArguments::resolve(const ResolveRules& rules) const {
    TrainOptions options = combine(rules);
    validate(options);
    return options;
}

TrainOptions TrainArguments::combine(const ResolveRules& rules) const {
    TrainOptions options = base(rules.stored_run);
    apply_flags(options);
    if (options.source.empty()) options.source = rules.default_source;
    return options;
}

}  // namespace gs
