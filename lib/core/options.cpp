// SPDX-License-Identifier: Apache-2.0
// Parses, formats and checks the values of options.
#include "lib/core/options.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

#include "kernels/base/error.h"
#include "lib/core/quantities.h"

namespace gs {
namespace {

template <class T> constexpr bool is_list = false;
template <class T> constexpr bool is_list<std::vector<T>> = true;
template <class T> constexpr bool is_optional = false;
template <class T> constexpr bool is_optional<std::optional<T>> = true;
template <class T> constexpr bool is_number = std::is_arithmetic_v<T> && !std::is_same_v<T, bool>;

[[noreturn]] void wrong_type(const std::string& where, const std::string& value, const std::string& expected) {
    throw UsageError(fmt::format("{}: '{}' is not {}", where, value, expected));
}

template <class T> T parse_number(const std::string& text, const std::string& where) {
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error == std::errc::result_out_of_range) wrong_type(where, text, "a number this option can hold");
    const bool complete = error == std::errc{} && end == text.data() + text.size();
    if constexpr (std::is_floating_point_v<T>) {
        if (!complete || !std::isfinite(value)) wrong_type(where, text, "a finite number");
    } else {
        if (!complete)
            wrong_type(where, text, std::is_signed_v<T> ? "a whole number" : "a whole number from 0 upwards");
    }
    return value;
}

bool parse_bool(const std::string& text, const std::string& where) {
    std::string lower = text;
    std::transform(lower.begin(), lower.end(), lower.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (lower == "true" || lower == "yes" || lower == "on") return true;
    if (lower == "false" || lower == "no" || lower == "off") return false;
    wrong_type(where, text, "true or false");
}

template <Choice T> T parse_choice(const std::string& text, const std::string& where) {
    if (const std::optional<T> value = choice_of<T>(text)) return *value;
    wrong_type(where, text, fmt::format("one of {}", fmt::join(kWordsOf<T>, ", ")));
}

Background parse_background(const std::string& text, const std::string& where) {
    if (const std::optional<Background> value = gs::parse_background(text)) return *value;
    wrong_type(where, text, kBackgroundValues);
}

template <class T> void parse_into(T& field, const std::string& text, const std::string& where) {
    if constexpr (std::is_same_v<T, std::string>)
        field = text;
    else if constexpr (std::is_same_v<T, bool>)
        field = parse_bool(text, where);
    else if constexpr (Choice<T>)
        field = parse_choice<T>(text, where);
    else if constexpr (std::is_same_v<T, Background>)
        field = parse_background(text, where);
    else if constexpr (std::is_same_v<T, Duration>)
        field = parse_duration(text, where);
    else if constexpr (std::is_same_v<T, ByteCount>)
        field = parse_bytes(text, where);
    else
        field = parse_number<T>(text, where);
}

/// Formats doubles in their shortest exact form.
template <class T> std::string number_text(T value) { return fmt::format("{}", value); }

template <class T> void check_number(const Option& option, T value) {
    const bool too_small = option.min && static_cast<double>(value) < *option.min;
    const bool too_large = option.max && static_cast<double>(value) > *option.max;
    if (too_small || too_large) {
        throw UsageError(
            fmt::format("option {}: {} is out of range ({})", option.key, number_text(value), option_range(option)));
    }
}

void check_choice(const Option& option, const std::string& value) {
    if (option.choices.empty() ||
        std::find(option.choices.begin(), option.choices.end(), value) != option.choices.end())
        return;
    throw UsageError(fmt::format("option {}: '{}' is not one of {}", option.key, value, option_range(option)));
}

void check_value(const Option& option, const TrainOptions& options) {
    std::visit(
        [&](const auto& field) {
            const auto& value = option_value(options, field);
            using T = std::decay_t<decltype(value)>;
            if constexpr (std::is_same_v<T, std::string>)
                check_choice(option, value);
            else if constexpr (is_list<T>) {
                for (auto element : value) check_number(option, element);
            } else if constexpr (is_optional<T>) {
                if constexpr (is_number<typename T::value_type>)
                    if (value) check_number(option, *value);
            } else if constexpr (is_number<T>)
                check_number(option, value);
        },
        option.field);
}

void check_resolution(int r) {
    // A width of 3 px is a mistyped divisor, not an intended width.
    if (r == 0 || r == 3 || (r > 4 && r < 8) || (r > 8 && r < 16)) {
        throw UsageError(fmt::format(
            "option resolution: {} is neither -1, a divisor (1, 2, 4, 8) nor a width in pixels (16 and more)", r));
    }
}

/// The shortest time limit in seconds: enough for a few steps and a small file.
constexpr double kShortestTime = 0.15;

/// The default of final-rate in runs in which Gaussians lose their residuals.
constexpr double kMixedFinalRate = 0.1;

/// Returns the defaults with the values of recipe frontier (docs/math/optimization.md#recipe).
const TrainOptions& frontier_values() {
    static const TrainOptions values = [] {
        TrainOptions options;
        for (const Option& option : train_option_table())
            if (!option.frontier.empty()) set_option(options, option, {option.frontier}, "recipe frontier");
        return options;
    }();
    return values;
}

/// Resolves recipe `auto`, and sets options that were not named to the values of recipe frontier.
void apply_recipe(TrainOptions& options) {
    if (options.recipe == Recipe::kAuto) {
        const bool limited = options.time_limit || options.size_limit || options.frame_limit || options.target_psnr;
        options.recipe = limited || options.preset != Preset::kNone ? Recipe::kFrontier : Recipe::kPaper;
    }
    if (options.recipe != Recipe::kFrontier) {
        // If Gaussians lose their residuals, the rest of the run is fine-tuning.
        if (options.takes_residuals_away() && !options.named.contains("final-rate"))
            options.final_rate = kMixedFinalRate;
        return;
    }
    for (const Option& option : train_option_table())
        if (!option.frontier.empty() && !options.named.contains(option.key))
            std::visit([&](const auto& f) { option_value(options, f) = option_value(frontier_values(), f); },
                       option.field);
}

}  // namespace

void apply_preset(TrainOptions& options) {
    if (options.preset == Preset::kNone) return;
    if (options.time_limit)
        throw UsageError("option preset: its length is a number of iterations, which time-limit replaces; give one");
    if (!options.named.contains("iterations"))
        options.iterations = options.preset == Preset::kFast       ? 5000
                             : options.preset == Preset::kBalanced ? 15000
                                                                   : 30000;
}

void apply_builtin_cap(TrainOptions& options) {
    if (has_builtin_cap(options)) options.cap_max = kBuiltinCap;
}

bool has_builtin_cap(const TrainOptions& options) {
    return options.source.starts_with("builtin:") && !options.named.contains("cap-max");
}

std::vector<std::string> kept_from_recipe(const TrainOptions& options) {
    std::vector<std::string> kept;
    if (options.recipe != Recipe::kFrontier) return kept;
    for (const Option& option : train_option_table())
        if (const std::string text = option_text(option, options);
            !option.frontier.empty() && text != option_text(option, frontier_values()))
            kept.push_back(option.key + " " + text);
    return kept;
}

std::vector<std::string> option_groups() {
    std::vector<std::string> groups;
    for (const Option& option : train_option_table()) {
        if (groups.empty() || groups.back() != option.group) groups.push_back(option.group);
    }
    return groups;
}

std::string option_range(const Option& option) {
    if (!option.values.empty()) return option.values;
    if (!option.choices.empty()) return fmt::format("{}", fmt::join(option.choices, ", "));
    if (option.min && option.max) {
        std::string words;
        const bool is_in_range = option.unset_word == number_text(*option.min);
        for (const std::string& word : {is_in_range ? "" : option.unset_word, option.max_word})
            if (!word.empty()) words += " or " + word;
        return fmt::format("{}..{}{}", number_text(*option.min), number_text(*option.max), words);
    }
    return "true or false";
}

std::string option_text(const Option& option, const TrainOptions& options) {
    const auto text = [&](const auto& self, const auto& value) -> std::string {
        using T = std::decay_t<decltype(value)>;
        if constexpr (is_optional<T>)
            return value ? self(self, *value) : option.unset_word;
        else if constexpr (std::is_same_v<T, std::string>)
            return value;
        else if constexpr (std::is_same_v<T, bool>)
            return value ? "true" : "false";
        else if constexpr (Choice<T>)
            return word(value);
        else if constexpr (std::is_same_v<T, Background>)
            return background_text(value);
        else if constexpr (std::is_same_v<T, Duration> || std::is_same_v<T, ByteCount>)
            return value.text();
        else if constexpr (is_list<T>)
            return fmt::format("[{}]", fmt::join(value, ", "));
        else
            return !option.max_word.empty() && value == T(*option.max) ? option.max_word : number_text(value);
    };
    return std::visit([&](const auto& field) { return text(text, option_value(options, field)); }, option.field);
}

namespace {

/// Parses one text into a value, with the special words of its option.
template <class T>
void read_value(T& value, const Option& option, bool is_whole, const std::string& text, const std::string& where) {
    if constexpr (is_optional<T>) {
        value.reset();
        if (text == option.unset_word) return;
        read_value(value.emplace(), option, is_whole, text, where);
        if constexpr (is_number<typename T::value_type>)  // "0.0", "00" and "-0" are other spellings of "0"
            if (number_text(*value + 0) == option.unset_word) value.reset();
    } else {
        if constexpr (is_number<T>) {
            if (!option.max_word.empty() && text == option.max_word)
                value = T(*option.max);
            else if (is_whole)
                value = T(parse_number<std::int64_t>(text, where));
            else
                value = parse_number<T>(text, where);
        } else {
            parse_into(value, text, where);
        }
    }
}

}  // namespace

void set_option(TrainOptions& options, const Option& option, const std::vector<std::string>& values,
                const std::string& where) {
    options.named.insert(option.key);
    std::visit(
        [&](const auto& field) {
            auto& value = option_value(options, field);
            if constexpr (is_list<std::decay_t<decltype(value)>>) {
                value.clear();
                for (const std::string& text : values)
                    if (text != "-1") parse_into(value.emplace_back(), text, where);  // -1 means an empty list
            } else {
                if (values.size() != 1)
                    throw UsageError(fmt::format("{}: needs exactly one value, got {}", where, values.size()));
                bool is_whole = false;
                if constexpr (std::is_same_v<std::decay_t<decltype(field)>, ModelOptionField>)
                    is_whole = field.is_whole;
                read_value(value, option, is_whole, values.front(), where);
            }
        },
        option.field);
}

void check_option(const Option& option, const TrainOptions& options) {
    check_value(option, options);
    if (option.key == "resolution" && options.resolution) check_resolution(*options.resolution);
}

LogLevel shown_messages(const OutputOptions& options) {
    if (options.quiet) return LogLevel::kWarn;
    return options.verbose ? LogLevel::kDebug : LogLevel::kInfo;
}

TrainOptions resolve(TrainOptions options) {
    if (options.source.empty())
        throw UsageError("option source: no scene given; name a folder or builtin:NAME, e.g. -s path/to/scene");
    for (const Option& option : train_option_table()) check_option(option, options);
    if (options.resume.ends_with(".ply"))
        throw UsageError(fmt::format(
            "option resume: '{}' is a point cloud, which holds no state of a training to continue; --init begins a new "
            "training with its Gaussians",
            options.resume));
    if (options.resume == "latest" && options.model.empty()) {
        throw UsageError("option resume: 'latest' needs the output folder that holds the checkpoints, -m FOLDER");
    }
    if (!options.ppisp_from.empty()) {
        if (options.ppisp == PpispMode::kAuto)
            throw UsageError(
                "option ppisp-from: the correction of another run is taken as it is; ppisp auto would decide whether "
                "one "
                "is needed");
        options.ppisp = PpispMode::kOn;
    }
    if (options.ppisp_exif && options.ppisp == PpispMode::kOff)
        throw UsageError("option ppisp-exif: there is no correction to start; give --ppisp on or auto as well");
    if (options.speedy_splat && options.strategy != Strategy::kAdc)
        throw UsageError(
            fmt::format("option speedy-splat: goes with strategy adc, not with {}", word(options.strategy)));
    apply_preset(options);
    apply_recipe(options);
    if (options.time_limit && options.time_limit->seconds < kShortestTime)
        throw UsageError(fmt::format("option time-limit: {} is less than the shortest useful one, {:g}s",
                                     options.time_limit->text(), kShortestTime));
    if (options.time_limit && options.schedule == ScheduleKind::kFixed)
        throw UsageError(
            "option schedule: fixed counts iterations, and a time limit does not say how many there will be");
    if (options.target_psnr && options.schedule == ScheduleKind::kFixed)
        throw UsageError("option schedule: fixed counts iterations, and a target does not say how many there will be");
    if (options.appearance_bytes && options.named.contains("appearance-share"))
        throw UsageError("option appearance-bytes: it is another way to say appearance-share; give one of them");
    if (options.target_psnr && options.strategy != Strategy::kMcmc)
        throw UsageError(
            fmt::format("option target-psnr: goes with strategy mcmc, not with {}", word(options.strategy)));
    // A .splat file stores one colour for all directions.
    if (options.size_limit && options.size_of == SizeOf::kSplat && !options.named.contains("appearance"))
        options.appearance = "none";
    if (!options.named.contains("opacity-lr"))
        options.opacity_lr = options.strategy == Strategy::kMcmc || options.speedy_splat ? 0.05 : 0.025;
    if (!options.controller_iterations && !options.time_limit)
        options.controller_iterations =
            options.schedule == ScheduleKind::kFixed ? 5000 : std::max<std::int64_t>(1, options.iterations / 6);
    return options;
}

}  // namespace gs
