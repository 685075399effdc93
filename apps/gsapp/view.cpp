// SPDX-License-Identifier: Apache-2.0
// gsapp view: serves an export to a browser on this machine.
#include <fmt/format.h>

#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "lib/export/file_server.h"

namespace gs {
namespace {

struct ViewArguments {
    std::string folder;
    int port = 8000;
};

void run_view(const ViewArguments& arguments) {
    FileServer server(arguments.folder, arguments.port);
    std::fputs(fmt::format("http://127.0.0.1:{}/\n", server.port()).c_str(), stdout);
    std::fflush(stdout);
    server.run();  // until Ctrl-C
}

}  // namespace

void add_view_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<ViewArguments>();
    CLI::App* command = app.add_subcommand("view", "Serve an export to a browser on this machine, until Ctrl-C");
    command->add_option("folder", arguments->folder, "Folder that gsapp export wrote")->required()->type_name("DIR");
    command->add_option("--port", arguments->port, "Port on 127.0.0.1; 0 takes any free one")
        ->capture_default_str()
        ->check(CLI::Range(0, 65535));
    command->callback([arguments, &selected] { selected = [arguments] { run_view(*arguments); }; });
}

}  // namespace gs
