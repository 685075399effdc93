// SPDX-License-Identifier: Apache-2.0
// Registers the table of options with CLI11 and reads the given values.
#include "lib/core/options_cli.h"

#include <algorithm>
#include <charconv>

#include <fmt/format.h>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/log.h"

namespace gs {
namespace {

/// The type of a value, or of the values that an optional or a list contains.
template <class T> struct Contained { using type = T; };
template <class T> struct Contained<std::optional<T>> { using type = T; };
template <class T> struct Contained<std::vector<T>> { using type = T; };

const char* type_word(const Option& option) {
    if (const auto* of_model = std::get_if<ModelOptionField>(&option.field))
        return of_model->is_whole ? "INTEGER" : "NUMBER";
    return std::visit(
        [](const auto& field) {
            using T = typename Contained<std::decay_t<decltype(option_value(TrainOptions{}, field))>>::type;
            if constexpr (std::is_same_v<T, double>) return "NUMBER";
            if constexpr (std::is_integral_v<T>) return "INTEGER";
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

std::vector<std::string> shown_spellings(const Option& option) {
    std::vector<std::string> names = option.names;
    names.push_back("--" + option.key);
    return names;
}

std::vector<std::string> hidden_spellings(const Option& option) {
    std::string underscores = "--" + option.key;
    std::replace(underscores.begin() + 2, underscores.end(), '-', '_');
    std::vector<std::string> names = {underscores};
    for (const ForeignProgram& program : foreign_programs())
        for (const ForeignOption& foreign : program.options)
            if (foreign.use == ForeignUse::kSynonym && foreign.key == option.key)
                for (const std::string& name : spellings(foreign)) names.push_back(name);
    return names;
}

/// Returns whether both texts are the same number, such as 1 and 1.0.
bool is_same_number(const std::string& a, const std::string& b) {
    const auto number = [](const std::string& text, double& value) {
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        return error == std::errc{} && end == text.data() + text.size();
    };
    double x = 0, y = 0;
    return number(a, x) && number(b, y) && x == y;
}

const Option& option_of(const std::string& key) {
    const auto& table = train_option_table();
    return *std::find_if(table.begin(), table.end(), [&](const Option& option) { return option.key == key; });
}

}  // namespace

CLI::Option* TrainArguments::declare_spelling(CLI::App& app, const Option& option, const std::string& names) {
    CLI::Option* cli = nullptr;
    const std::string help = help_text(option);
    if (is_switch(option)) {
        cli = app.add_flag(names, help);
    } else {
        // `resolve` parses the values from text, so that file and command line share one parser.
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
    // The last of repeated flags applies, as in 3DGS, so that its scripts run unchanged.
    if (!is_list_option(option)) cli->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
    flags_.push_back({&option, cli});
    return cli;
}

/// Returns the `names` that are not yet declared, separated by commas for CLI11, and marks them as declared.
std::string TrainArguments::new_names(const std::vector<std::string>& names) {
    std::string list;
    for (const std::string& name : names)
        if (names_.insert(name).second) list += (list.empty() ? "" : ",") + name;
    return list;
}

void TrainArguments::declare(CLI::App& app, const Option& option, const std::vector<std::string>& names,
                             const std::string& group) {
    CLI::Option* visible = declare_spelling(app, option, new_names(names))->group(group);
    const std::string default_text = option_text(option, TrainOptions{});
    if (!is_switch(option) && option.implicit.empty() && default_text != "[]") visible->default_str(default_text);
    if (const std::string hidden = new_names(hidden_spellings(option)); !hidden.empty())
        declare_spelling(app, option, hidden)->group("");
}

TrainArguments::TrainArguments(CLI::App& app, const std::string& without) {
    app.add_option("-c,--config", config_, "YAML file with options; flags override it")->type_name("FILE");
    for (const Option& option : train_option_table())
        if (option.key != without) {
            std::vector<std::string> names = shown_spellings(option);
            if (option.key == "source") names.push_back("scene");
            declare(app, option, names, option.group);
        }
    declare_foreign(app, without);
    if (without.empty()) app.add_option(kForeignCommandFlag, foreign_command_)->group("");
    app.get_option("-w")->group("Run")->description("short for --background white; overrides --background");
}

TrainArguments::TrainArguments(CLI::App& app, const std::vector<std::string>& keys, const std::string& group) {
    const auto is_wanted = [&](const std::string& key) {
        return std::find(keys.begin(), keys.end(), key) != keys.end();
    };
    for (const Option& option : train_option_table()) {
        if (is_wanted(option.key)) declare(app, option, shown_spellings(option), group);
    }
    for (const ForeignProgram& program : foreign_programs())
        for (const ForeignOption& option : program.options)
            if (option.use == ForeignUse::kSets && is_wanted(option.key)) declare_foreign(app, program, option);
    if (is_wanted("background")) app.get_option("-w")->group(group)->description("Short for --background white");
}

void TrainArguments::declare_foreign(CLI::App& app, const std::string& without) {
    for (const ForeignProgram& program : foreign_programs())
        for (const ForeignOption& foreign : program.options) {
            const bool left_out = !without.empty() && foreign.key == without;
            if (foreign.use == ForeignUse::kSynonym || left_out) continue;
            declare_foreign(app, program, foreign);
        }
}

void TrainArguments::declare_foreign(CLI::App& app, const ForeignProgram& program, const ForeignOption& option) {
    const std::string names = new_names(spellings(option));
    if (names.empty()) return;
    const bool takes_value = option.use != ForeignUse::kSets && !option.is_switch;
    CLI::Option* cli =
        takes_value ? app.add_option(names, [](const CLI::results_t&) { return true; }) : app.add_flag(names);
    foreign_.push_back({&program, &option, cli->group("")});
}

/// Returns whether the command line gives this flag with an effect, i.e. not as `--flag=false` or with the value
/// without effect.
bool TrainArguments::ForeignFlag::given() const {
    if (cli->count() == 0) return false;
    const bool has_value = option->use != ForeignUse::kSets && !option->is_switch;
    if (!has_value) return cli->as<bool>();
    const std::string& value = cli->results().back();
    return value != option->value && !is_same_number(value, option->value);
}

void TrainArguments::check_foreign() const {
    if (const ForeignCommand* command = foreign_command()) {
        if (!command->missing.empty())
            throw UsageError(fmt::format("{} of {}: not yet: {}", command->word, command->program, command->missing));
        std::string meaning;
        for (const auto& [key, value] : command->settings)
            if (!given().contains(key)) meaning += value == "true" ? " --" + key : " --" + key + " " + value;
        log_info("{}, as for {}:{}", command->word, command->program, meaning);
    }
    for (const ForeignFlag& flag : foreign_) {
        if (!flag.given()) continue;
        if (flag.option->use == ForeignUse::kMissing)
            throw UsageError(
                fmt::format("{} of {}: not yet: {}", flag.option->name, flag.program->name, flag.option->note));
        if (flag.option->use == ForeignUse::kIgnored)
            log_warning("{} of {} is ignored: {}", flag.option->name, flag.program->name, flag.option->note);
    }
}

const ForeignCommand* TrainArguments::foreign_command() const {
    const auto& commands = foreign_commands();
    const auto found = std::find_if(commands.begin(), commands.end(),
                                    [&](const ForeignCommand& c) { return c.word == foreign_command_; });
    return found == commands.end() ? nullptr : &*found;
}

void TrainArguments::apply_flags(TrainOptions& options) const {
    if (const ForeignCommand* command = foreign_command())
        for (const auto& [key, value] : command->settings) set_option(options, option_of(key), {value}, command->word);
    const Option* previous = nullptr;
    for (const Flag& flag : flags_) {
        if (flag.cli->count() == 0) continue;
        if (flag.option == previous)
            throw UsageError(fmt::format("option {} is given twice, in two spellings", flag.option->key));
        previous = flag.option;
        // An empty value would start a new training, the opposite of the intention.
        if (flag.option->key == "resume" && flag.cli->reduced_results() == std::vector<std::string>{""})
            throw UsageError(
                "option resume: its value is empty, perhaps a variable of a script that is not set; name a checkpoint "
                "file, or latest, which --resume alone means as well");
        if (is_switch(*flag.option)) {
            options.*std::get<bool TrainOptions::*>(flag.option->field) = flag.cli->as<bool>();
        } else {
            set_option(options, *flag.option, flag.cli->reduced_results(), "--" + flag.option->key);
        }
    }
    const ForeignFlag* other = nullptr;
    for (const ForeignFlag& flag : foreign_) {
        if (flag.option->use != ForeignUse::kSets || !flag.given()) continue;
        if (other && other->option->key == flag.option->key && other->option->value != flag.option->value)
            throw UsageError(fmt::format("{} and {}: not yet: each sets --{}, which has one value", other->option->name,
                                         flag.option->name, flag.option->key));
        other = &flag;
        set_option(options, option_of(flag.option->key), {flag.option->value}, flag.option->name);
    }
}

void TrainArguments::apply(TrainOptions& options) const {
    apply_flags(options);
    const std::set<std::string> keys = given();
    for (const Option& option : train_option_table())
        if (keys.contains(option.key)) check_option(option, options);
}

std::set<std::string> TrainArguments::given() const {
    std::set<std::string> keys;
    for (const Flag& flag : flags_)
        if (flag.cli->count() > 0) keys.insert(flag.option->key);
    for (const ForeignFlag& flag : foreign_)
        if (flag.option->use == ForeignUse::kSets && flag.given()) keys.insert(flag.option->key);
    return keys;
}

TrainOptions TrainArguments::base(bool stored_run) const {
    if (!config_.empty()) return load_options_yaml(config_);
    TrainOptions flags_only;
    apply_flags(flags_only);
    const std::filesystem::path run = flags_only.model;
    const bool wanted = !flags_only.resume.empty() || (stored_run && !run.empty());
    if (!wanted || !path_exists(run / "config.yaml")) return {};
    TrainOptions options = load_run_options(run);
    for (const Option& option : train_option_table())
        if (option.scope == Scope::kCall)
            std::visit([&](const auto& f) { option_value(options, f) = option_value(TrainOptions{}, f); },
                       option.field);
    return options;
}

TrainOptions TrainArguments::resolve(const ResolveRules& rules) const { return gs::resolve(combine(rules)); }

TrainOptions TrainArguments::combine(const ResolveRules& rules) const {
    check_foreign();
    TrainOptions options = base(rules.stored_run);
    apply_flags(options);
    if (options.source.empty()) options.source = rules.default_source;
    apply_builtin_cap(options);
    return options;
}

}  // namespace gs
