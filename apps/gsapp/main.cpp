// SPDX-License-Identifier: Apache-2.0
// The program `gsapp`: parses the command line, runs one subcommand, and turns errors into one message and an exit
// code.

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <iostream>
#include <iterator>
#include <new>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "apps/gsapp/command.h"
#include "apps/gsapp/command_tree.h"
#include "apps/gsapp/printing.h"
#include "kernels/base/error.h"
#include "lib/core/foreign_options.h"
#include "lib/core/interrupt.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/nearest.h"

namespace gs {
namespace {

/// Returns every flag and subcommand that is valid if `app` is the innermost command.
std::vector<std::string> known_words(const CLI::App& app) {
    std::vector<std::string> words;
    for (const CLI::Option* option : app.get_options()) {
        for (const std::string& name : option->get_lnames()) words.push_back("--" + name);
        for (const std::string& name : option->get_snames()) words.push_back("-" + name);
    }
    for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
        words.push_back(sub->get_name());
    return words;
}

/// Returns the program's name with the subcommands of the command line: "gsapp bench frames".
std::string called_command(const CLI::App& app) {
    std::string text = "gsapp";
    for (auto called = app.get_subcommands(); !called.empty(); called = called.front()->get_subcommands())
        text += " " + called.front()->get_name();
    return text;
}

/// Returns the message for an invalid command line. For an unknown word it suggests a similar known word; otherwise it
/// is CLI11's own message.
std::string usage_message(const CLI::App& app, const CLI::ParseError& error) {
    const CLI::App* command = &app;
    while (!command->get_subcommands().empty()) command = command->get_subcommands().front();
    for (const std::string& word : app.remaining(true)) {
        if (word.empty() || (word[0] != '-' && command != &app)) continue;
        const std::string name = word.substr(0, word.find('='));
        const char* kind = word[0] == '-' ? "option" : "command";
        return "unknown " + std::string(kind) + " '" + name + "'" + did_you_mean(name, known_words(*command));
    }
    return error.what();
}

/// Restricts the numbers of `app` and its subcommands to decimals. CLI11 also accepts 0x10, 010 (as 8) and "nan".
void require_decimal_numbers(CLI::App& app) {
    const CLI::Validator decimal(
        [](std::string& text) {
            double value = 0;
            const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
            const bool whole = error == std::errc{} && end == text.data() + text.size();
            const std::size_t digits = text.find_first_not_of('-');
            const bool octal = text.size() > digits + 1 && text[digits] == '0' && std::isdigit(text[digits + 1]);
            return whole && std::isfinite(value) && !octal ? "" : "'" + text + "' is not a decimal number";
        },
        "");
    for (CLI::Option* option : app.get_options()) {
        const std::string type = option->get_type_name(), word = type.substr(0, type.find(':'));
        if (word == "INT" || word == "UINT" || word == "FLOAT") option->check(decimal);
    }
    for (CLI::App* sub : app.get_subcommands([](CLI::App*) { return true; })) require_decimal_numbers(*sub);
}

struct KnownCommand {
    std::string_view name;
    void (*add)(CLI::App& app, Command& selected);
    bool describes_others = false;  ///< whether it prints information about all commands
};
constexpr KnownCommand kCommands[] = {
    {"train", add_train_command},        {"eval", add_eval_command},
    {"render", add_render_command},      {"export", add_export_command},
    {"view", add_view_command},          {"prepare", add_prepare_command},
    {"bench", add_bench_command},        {"tradeoff", add_tradeoff_command},
    {"metrics", add_metrics_command},    {"options", add_options_command},
    {"doctor", add_doctor_command},      {"completions", add_completions_command, true},
    {"manual", add_manual_command, true}};

/// Returns whether `command` must be declared to parse `words`. Declaring all commands takes most of the program's
/// start time, because CLI11 compares each option with all earlier ones.
bool is_needed(const KnownCommand& command, const std::vector<std::string>& words) {
    const auto is_version = [](const std::string& word) { return word == "--version" || word == "--json"; };
    if (!words.empty() && std::all_of(words.begin(), words.end(), is_version)) return false;
    const auto named = std::find_if(std::begin(kCommands), std::end(kCommands),
                                    [&](const KnownCommand& one) { return !words.empty() && one.name == words[0]; });
    return named == std::end(kCommands) || named->describes_others || named->name == command.name;
}

int run(int argc, char** argv) {
    CLI::App app("Trains and evaluates 3D Gaussian splatting scenes.", "gsapp");
    set_up_help(app);
    bool is_json = false;  // set too late for the callback, which therefore uses count()
    const CLI::Option* json = nullptr;
    // Computed only on request: waking the GPU takes a while.
    CLI::Option* version = app.set_version_flag(
        "--version", [&json] { return json->count() > 0 ? json_text(version_json(), 1) : version_report(); });
    json = app.add_flag("--json", is_json, "With --version: print it as JSON")->needs(version);
    app.require_subcommand(1);
    Command selected;
    std::vector<std::string> words = with_foreign_command({argv + 1, argv + argc});
    for (const KnownCommand& command : kCommands)
        if (is_needed(command, words)) command.add(app, selected);
    require_decimal_numbers(app);
    try {
        std::reverse(words.begin(), words.end());  // CLI11 expects reverse order
        app.parse(std::move(words));
    } catch (const CLI::Success& help_or_version) {
        return app.exit(help_or_version);
    } catch (const CLI::ParseError& error) {
        throw UsageError(usage_message(app, error) + "\nTry '" + called_command(app) + " --help'.");
    }
    selected();
    return static_cast<int>(ExitCode::kOk);
}

/// Opens the standard descriptors that the caller has closed, so that no file of the program takes their numbers.
/// stdout is opened read-only, so that printing to it is an error.
void open_standard_descriptors() {
    for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
        if (::fcntl(fd, F_GETFD) < 0) (void)::open("/dev/null", fd == STDERR_FILENO ? O_WRONLY : O_RDONLY);
}

/// Throws DataError if output to stdout was lost. Streams do not report this by themselves.
void require_printed() {
    std::cout.flush();
    errno = 0;
    const bool flushed = std::fflush(stdout) == 0;
    if (flushed && std::ferror(stdout) == 0 && std::cout) return;
    throw DataError(std::string("stdout cannot be written") +
                    (flushed ? "" : std::string(": ") + std::strerror(errno)) +
                    "; what the command prints is missing or incomplete");
}

/// Logs an error and returns its exit code. Every error ends the program through this function.
int report(const std::string& message, ExitCode code) {
    if (!message.empty()) log_error("{}", message);
    return static_cast<int>(code);
}

/// Reports the exception being handled. Returns the exit code.
int report_exception() {
    try {
        throw;
    } catch (const Interrupted& e) {
        log_warning("{}", e.what());
        return static_cast<int>(e.code());
    } catch (const Error& e) {
        return report(e.what(), e.code());
    } catch (const std::filesystem::filesystem_error& e) {
        const std::string path = e.path2().empty() ? e.path1().string() : e.path2().string();
        return report(path + ": " + e.code().message(), ExitCode::kDataset);
    } catch (const std::system_error& e) {  // a thread or lock that the system refused
        return report(std::string("the system refused: ") + e.what(), ExitCode::kDevice);
    } catch (const std::bad_alloc&) {
        return report("out of memory; a smaller --cap-max, --image-cache or -r helps", ExitCode::kDevice);
    } catch (const std::exception& e) {
        const std::string reason = e.what();
        if (reason.starts_with("pthread_"))
            return report("the system refused: " + reason, ExitCode::kDevice);  // from TBB
        return report("unexpected: " + reason, ExitCode::kUnexpected);
    } catch (...) {
        return report("unexpected: an exception of an unknown kind", ExitCode::kUnexpected);
    }
}

/// Whether messages can be logged, which is so once main has started.
bool has_log = false;

/// Ends the program with a message if an exception cannot reach main: before main, or in a library thread that
/// exceptions cannot leave, such as those in which TBB and the HTTP server start further threads.
[[noreturn]] void end_from_anywhere() noexcept {
    static std::atomic<bool> ending = false;
    static thread_local bool is_reporting = false;
    if (!std::current_exception()) std::abort();
    if (std::exchange(is_reporting, true))
        std::_Exit(static_cast<int>(ExitCode::kDevice));  // out of memory while reporting
    while (ending.exchange(true)) ::pause();              // another thread reports the error and ends the program
    if (has_log) std::_Exit(report_exception());
    constexpr char kMessage[] = "error: the system gives too few threads or too little memory to begin\n";
    if (::write(STDERR_FILENO, kMessage, sizeof kMessage - 1) < 0) std::abort();
    std::_Exit(static_cast<int>(ExitCode::kDevice));
}

/// Runs before the initialisation of shared libraries, some of which start threads.
void before_libraries(int, char**, char**) { std::set_terminate(end_from_anywhere); }
[[gnu::section(".preinit_array"), gnu::used]] void (*first_call)(int, char**, char**) = before_libraries;

}  // namespace
}  // namespace gs

int main(int argc, char** argv) {
    gs::ignore_write_signals();
    gs::open_standard_descriptors();
    gs::setup_log(gs::LogLevel::kInfo);
    gs::has_log = true;
    try {
        const int code = gs::run(argc, argv);
        gs::require_printed();
        return code;
    } catch (...) {
        return gs::report_exception();
    }
}
