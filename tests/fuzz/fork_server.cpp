// SPDX-License-Identifier: Apache-2.0
// gsapp_server: gsapp, started once and forked for every command, which saves the loading of libraries. tests/fuzz/
// mutate.py sends a line per command, its fields separated by 0x1F: folder to work in, files for stdout and stderr,
// seconds it may compute, arguments. A line comes back: "exit CODE" or "signal NUMBER", peak memory in KiB,
// milliseconds.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "lib/io/image_module.h"

// The linker gives the program's own main this name (--wrap=main), and calls ours.
extern "C" int __real_main(int argc, char** argv);
extern "C" int __wrap_main(int argc, char** argv);

namespace {

std::vector<std::string> fields_of(const std::string& line) {
    std::vector<std::string> fields(1);
    for (const char c : line) {
        if (c == '\x1f')
            fields.emplace_back();
        else
            fields.back() += c;
    }
    return fields;
}

void redirect(const std::string& file, int descriptor) {
    const int opened = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    if (opened < 0 || ::dup2(opened, descriptor) < 0) std::_Exit(98);
    ::close(opened);
}

[[noreturn]] void run(std::vector<std::string> fields) {
    ::close(STDIN_FILENO);  // the server's
    if (::open("/dev/null", O_RDONLY) != STDIN_FILENO || ::chdir(fields[0].c_str()) != 0) std::_Exit(98);
    redirect(fields[1], STDOUT_FILENO);
    redirect(fields[2], STDERR_FILENO);
    const unsigned seconds = unsigned(std::atoi(fields[3].c_str()));
    const rlimit computing{seconds, seconds};  // processor time, for the machine may be busy with other work
    ::setrlimit(RLIMIT_CPU, &computing);
    ::alarm(10 * seconds);  // for a program that waits
    std::vector<char*> arguments = {fields[0].data()};
    for (std::size_t i = 4; i < fields.size(); ++i) arguments.push_back(fields[i].data());
    const int count = int(arguments.size());
    arguments.push_back(nullptr);
    const int code = __real_main(count, arguments.data());
    std::cout.flush();
    std::fflush(nullptr);
    std::_Exit(code);  // libraries would wait for threads that they started before the fork
}

}  // namespace

int __wrap_main(int, char**) {
    gs::image_module();  // else every command would load it
    for (std::string line; std::getline(std::cin, line);) {
        const std::vector<std::string> fields = fields_of(line);
        if (fields.size() < 5) return 2;
        const auto start = std::chrono::steady_clock::now();
        const pid_t child = ::fork();
        if (child < 0) return 3;
        if (child == 0) run(fields);
        int status = 0;
        rusage usage{};
        ::wait4(child, &status, 0, &usage);
        const auto took = std::chrono::steady_clock::now() - start;
        std::printf("%s %d %ld %lld\n", WIFEXITED(status) ? "exit" : "signal",
                    WIFEXITED(status) ? WEXITSTATUS(status) : WTERMSIG(status), usage.ru_maxrss,
                    static_cast<long long>(std::chrono::duration_cast<std::chrono::milliseconds>(took).count()));
        std::fflush(stdout);
    }
    return 0;
}
