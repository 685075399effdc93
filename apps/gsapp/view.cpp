// SPDX-License-Identifier: Apache-2.0
// gsapp view: serves an export to a browser on this machine.
#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>

#include "apps/gsapp/command.h"
#include "kernels/core/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/export/file_server.h"

namespace gs {
namespace {

struct ViewArguments {
    std::string folder;
    int port = 8000;
};

/// Returns the path of what a browser is to open: the viewer's page, or the scene of an export without the viewer.
/// Throws UsageError for what is no folder, DataError for a folder that holds neither.
std::string page_of(const std::filesystem::path& folder) {
    std::error_code ignored;
    if (!std::filesystem::is_directory(folder, ignored))
        throw UsageError(fmt::format("'{}' is not a folder; gsapp export RUN -o DIR makes one", folder.string()));
    if (std::filesystem::is_regular_file(folder / "index.html", ignored)) return "";
    if (!std::filesystem::is_regular_file(folder / "scene.ngsplat", ignored))
        throw DataError(
            fmt::format("'{}' holds no export: index.html and scene.ngsplat are missing. Write one with: "
                        "gsapp export RUN -o DIR, then: gsapp view DIR",
                        folder.string()));
    log_warning(
        "'{}' holds scene.ngsplat without a viewer (index.html), so that only the scene is served; "
        "scripts/build-viewer builds the viewer, and gsapp export --overwrite then writes it",
        folder.string());
    return "scene.ngsplat";
}

void run_view(const ViewArguments& arguments) {
    const std::string page = page_of(arguments.folder);
    FileServer server(arguments.folder, arguments.port);
    catch_interrupts();
    std::fputs(fmt::format("http://127.0.0.1:{}/{}\n", server.port(), page).c_str(), stdout);
    std::fflush(stdout);
    server.run();  // until Ctrl-C, which is the way to end it: exit code 0
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
