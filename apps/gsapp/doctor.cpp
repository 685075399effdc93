// SPDX-License-Identifier: Apache-2.0
// `gsapp doctor`: the hardware and software on this machine that gsapp can use, the missing parts, and how to install
// them.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <thread>

#include "apps/gsapp/command.h"
#include "apps/gsapp/printing.h"
#include "kernels/cuda/cuda_device.h"
#include "kernels/ranks/connect_devices.h"
#include "lib/core/cpu_features.h"
#include "lib/core/json_text.h"
#include "lib/core/quantities.h"
#include "lib/core/version.h"
#include "lib/export/site.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr double kGiB = 1024.0 * 1024 * 1024;
/// Approximate bytes written by a run of 1.5 M Gaussians, with a checkpoint and its temporary copy.
constexpr double kRoomOfARun = 2 * kGiB;

/// One component that was looked for. The program works without any of them.
struct Finding {
    std::string name, found;        ///< `found` is empty if it is missing or unusable
    std::string needed_for;         ///< features that need it
    std::string get;                ///< how to install it; empty if that is impossible
    std::string state = "missing";  ///< status if `found` is empty
};

/// Returns the path of a program on PATH, empty if there is none. As in the shell, an empty entry means ".".
std::string program_path(const std::string& name) {
    const char* const path = std::getenv("PATH");
    std::istringstream folders(path != nullptr ? path : "");
    for (std::string folder; std::getline(folders, folder, ':');) {
        const fs::path file = fs::path(folder.empty() ? "." : folder) / name;
        std::error_code ignored;
        if (fs::is_regular_file(file, ignored) && ::access(file.c_str(), X_OK) == 0) return file.string();
    }
    return {};
}

Finding program(const std::string& name, const std::vector<std::string>& names, const std::string& needed_for,
                const std::string& get) {
    Finding finding{.name = name, .found = {}, .needed_for = needed_for, .get = get};
    for (const std::string& one : names)
        if (finding.found.empty()) finding.found = program_path(one);
    return finding;
}

/// Returns the first line of a kernel file, empty if there is none.
std::string first_line(const char* path) {
    std::ifstream file(path);
    std::string line;
    std::getline(file, line);
    return line;
}

/// Returns the value of `key` in /proc/meminfo, in bytes; 0 if it is missing.
double memory(const std::string& key) {
    std::ifstream file("/proc/meminfo");
    std::string name, unit;
    double kilobytes = 0;
    while (file >> name >> kilobytes && std::getline(file, unit))
        if (name == key + ":") return kilobytes * 1024;
    return 0;
}

/// Reports the CPU. A CPU that lacks required instructions never reaches this code (cpu_check.cpp).
Finding cpu_finding() {
    return {.name = "CPU",
            .found = fmt::format("{} threads; built for {} ({})", std::thread::hardware_concurrency(),
                                 cpu_architecture(), fmt::join(built_cpu_features(), " ")),
            .needed_for = {},
            .get = {}};
}

/// Runs one kernel: this build may lack code for a GPU although it is visible.
Finding gpu_finding() {
    const std::string failure = try_cuda_device();
    Finding finding{.name = "GPU",
                    .found = failure.empty() ? cuda_driver_description() + "; a kernel ran" : "",
                    .needed_for = "training tens of times faster than on the CPU",
                    .get = "an NVIDIA GPU of compute capability 8.0 or later with its driver; nvidia-smi must see it"};
    if (cuda_device_count() > 0)
        finding.state = "cannot be used, training runs on the CPU", finding.get = failure;
    else
        finding.needed_for += "; " + failure;
    if (cuda_architectures().empty())
        finding.get = "build gsapp where nvcc is found: cmake --preset release -DGSAPP_CUDA=ON";
    return finding;
}

Finding driver_finding() {
    return {.name = "NVIDIA driver",
            .found = first_line("/proc/driver/nvidia/version"),
            .needed_for = "the GPU",
            .get = "on Debian, from non-free: apt-get install nvidia-driver; a container is started with --gpus all"};
}

Finding nccl_finding() {
    const NcclFinding nccl = find_nccl();
    return {
        .name = "NCCL",
        .found = nccl.why_not.empty() ? fmt::format("{} in {}", nccl.version, nccl.path) : "",
        .needed_for = "several GPUs (gsapp train --gpus), between which splats else pass through the host's memory; " +
                      nccl.why_not,
        .get = kGetNccl};
}

Finding memory_finding() {
    const double total = memory("MemTotal"), free = memory("MemAvailable");
    return {.name = "memory",
            .found = total > 0 ? fmt::format("{:.1f} GiB, {:.1f} GiB of them free", total / kGiB, free / kGiB) : "",
            .needed_for = "knowing whether photographs fit (--image-cache)",
            .get = "mount /proc"};
}

Finding disk_finding() {
    std::error_code error;
    const fs::space_info space = fs::space(".", error);
    Finding finding{.name = "free disk",
                    .found = {},
                    .needed_for = "a run with its checkpoints, about 2 GiB at 1.5 M Gaussians",
                    .get = "work in a folder on another disk"};
    if (error)
        finding.needed_for += "; the current folder cannot be asked: " + error.message();
    else if (const double free = double(space.available); free >= kRoomOfARun)
        finding.found = fmt::format("{:.1f} GiB in the current folder", free / kGiB);
    else
        finding.needed_for += fmt::format("; the current folder has {:.1f} GiB", free / kGiB);
    return finding;
}

Finding weights_finding() {
    const char* const folder = std::getenv("GSAPP_METRIC_WEIGHTS");
    int files = 0;
    std::error_code ignored;
    if (folder != nullptr)
        for (const auto& entry : fs::directory_iterator(folder, ignored))
            files += entry.path().extension() == ".safetensors";
    return {.name = "metric weights",
            .found = files > 0 ? fmt::format("{} files in {}", files, folder) : "",
            .needed_for = "LPIPS, DISTS and MILO (gsapp eval --metrics all)",
            .get = "scripts/export_metric_weights.py DIR, which needs PyTorch, and GSAPP_METRIC_WEIGHTS=DIR"};
}

std::vector<Finding> look_around() {
    return {cpu_finding(),
            memory_finding(),
            gpu_finding(),
            driver_finding(),
            nccl_finding(),
            disk_finding(),
            {.name = "web viewer",
             .found = viewer_folder().string(),
             .needed_for = "gsapp export --format web, gsapp view of runs, and gsapp train --view",
             .get = "scripts/build-viewer in the sources, then cmake --install; or keep share/gsapp beside bin"},
            program("colmap", {"colmap"}, "gsapp prepare, which finds the cameras of photographs",
                    "apt-get install colmap"),
            program("ffmpeg", {"ffmpeg"}, "making videos of rendered pictures, and taking photographs out of a video",
                    "apt-get install ffmpeg"),
            program("Chromium", {"chromium", "chromium-browser", "google-chrome"},
                    "tests of pages; any browser with WebGL2 shows a scene", "apt-get install chromium"),
            program("node", {"node"}, "building the web viewer", "apt-get install nodejs npm"),
            weights_finding()};
}

std::string text_of(const std::vector<Finding>& findings) {
    std::string text = version_text() + "\n";
    if (!cuda_architectures().empty()) text += "built for CUDA " + cuda_architectures() + "\n";
    for (const Finding& finding : findings) {
        if (!finding.found.empty())
            text += fmt::format("  {:<15} {}\n", finding.name, finding.found);
        else
            text += fmt::format("- {:<15} {}\n  {:<15} for: {}\n  {:<15} get: {}\n", finding.name, finding.state, "",
                                finding.needed_for, "", finding.get);
    }
    return text + "gsapp itself works" + (cuda_available() ? "" : ", on the CPU") +
           "; what is missing is only needed for what the list says.\n";
}

std::string json_of(const std::vector<Finding>& findings) {
    nlohmann::ordered_json json = {{"gsapp", version_json()}};
    for (const Finding& finding : findings) {
        nlohmann::ordered_json one = {{"name", finding.name}, {"is_there", !finding.found.empty()}};
        if (finding.found.empty())
            one.update({{"state", finding.state}, {"needed_for", finding.needed_for}, {"get", finding.get}});
        else
            one["found"] = finding.found;
        json["findings"].push_back(one);
    }
    return json_text(json, 1) + "\n";
}

void run_doctor(bool json) {
    const std::vector<Finding> findings = look_around();
    std::fputs((json ? json_of(findings) : text_of(findings)).c_str(), stdout);
}

}  // namespace

void add_doctor_command(CLI::App& app, Command& selected) {
    const auto json = std::make_shared<bool>(false);
    CLI::App* command = app.add_subcommand(
        "doctor", "Look at this machine: what is there of all that gsapp can use, what is missing, how to get it");
    command->add_flag("--json", *json, "Print the same as JSON");
    command->callback([json, &selected] { selected = [json] { run_doctor(*json); }; });
}

}  // namespace gs
