// SPDX-License-Identifier: Apache-2.0
// gsapp view: shows an export, a run or a point cloud in a browser on this machine.
#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>

#include "apps/gsapp/command.h"
#include "apps/gsapp/live/saved_page.h"
#include "apps/gsapp/printing.h"
#include "eval/runs/saved_run.h"
#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/export/file_server.h"
#include "lib/model/model_file.h"
#include "lib/model/run_folder.h"

namespace gs {
namespace {

struct ViewArguments {
    std::string target, source;
    int port = 8000;
};

/// Returns whether `target` must be packed first: a point cloud, or a run. A file of another kind counts as one, too,
/// and is rejected with its name when it is read.
bool has_to_be_packed(const std::filesystem::path& target) {
    std::error_code ignored;
    if (std::filesystem::is_directory(target, ignored))
        return std::filesystem::is_regular_file(RunFolder{target}.config(), ignored);
    return is_point_cloud(target);
}

/// Returns the path to open in a browser, relative to the folder: the viewer's page, or the scene of an export without
/// the viewer. Throws UsageError if `folder` is not a folder, DataError if it contains neither.
std::string page_of(const std::filesystem::path& folder) {
    std::error_code ignored;
    if (!std::filesystem::is_directory(folder, ignored))
        throw UsageError(
            fmt::format("'{}' is neither a folder nor a .ply file; gsapp view shows what gsapp export wrote, a run, or "
                        "a point cloud",
                        folder.string()));
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

void print_address(const std::string& address) {
    log_info("open this address in a browser; Ctrl-C ends the server");
    std::fputs((address + "\n").c_str(), stdout);
    std::fflush(stdout);
}

/// Serves until Ctrl-C, the normal way to end it: exit code 0.
void run_view(const ViewArguments& arguments) {
    require_model_file(arguments.target);
    if (has_to_be_packed(arguments.target)) {
        if (!arguments.source.empty() && !std::filesystem::is_directory(arguments.target))
            throw UsageError("--source: a point cloud is shown without photographs; the option goes with a run");
        catch_interrupts();
        SavedPage page(arguments.target, arguments.source, arguments.port);
        print_address(page.address());
        page.run();
        return;
    }
    if (!arguments.source.empty())
        throw UsageError(fmt::format("--source: '{}' is an export, which has its own photographs", arguments.target));
    const std::string page = page_of(arguments.target);
    FileServer server(arguments.target, arguments.port);
    catch_interrupts();
    print_address(fmt::format("http://127.0.0.1:{}/{}", server.port(), page));
    server.run();
}

}  // namespace

void add_view_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<ViewArguments>();
    CLI::App* command =
        app.add_subcommand("view", "Show an export, a run or a point cloud in a browser on this machine, until Ctrl-C");
    command
        ->add_option("target", arguments->target,
                     "Folder that gsapp export wrote, run folder (also of a run that is still training), or .ply file")
        ->required()
        ->type_name("DIR|RUN|FILE.ply");
    command
        ->add_option("-s,--source", arguments->source,
                     "Scene of a run, if it is no longer where it was at the training: its photographs are shown")
        ->type_name("SCENE");
    command->add_option("--port", arguments->port, "Port on 127.0.0.1; 0 takes any free one")
        ->capture_default_str()
        ->check(CLI::Range(0, 65535));
    add_quiet_flag(*command);
    command->callback([arguments, &selected] { selected = [arguments] { run_view(*arguments); }; });
}

}  // namespace gs
