// SPDX-License-Identifier: Apache-2.0
#include "apps/gsapp/suite.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <mutex>
#include <sstream>
#include <thread>

#include "eval/suite.h"
#include "eval/table.h"
#include "kernels/core/error.h"
#include "kernels/cuda_device.h"
#include "lib/core/interrupt.h"
#include "lib/core/options.h"
#include "lib/core/process.h"
#include "lib/io/atomic_file.h"
#include "lib/train/choose_backend.h"
#include "lib/train/scene_options.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Rounds through the test views in which frames are timed: about a second on a GPU; on the CPU one round is as long.
constexpr int kFrameRoundsCuda = 20, kFrameRoundsCpu = 1;

/// What CUDA_VISIBLE_DEVICES has to be for each GPU that this process sees.
std::vector<std::string> visible_gpus() {
    std::vector<std::string> names;
    if (const char* chosen = std::getenv("CUDA_VISIBLE_DEVICES")) {
        std::istringstream list(chosen);
        for (std::string name; std::getline(list, name, ',');) names.push_back(name);
    }
    const auto count = std::size_t(cuda_device_count());
    for (std::size_t k = names.size(); k < count; ++k) names.push_back(std::to_string(k));
    names.resize(count);
    return names;
}

/// The message of a program that ended with an error, out of the last lines it printed.
std::string error_of(const ProcessResult& result) {
    static const std::string kMark = "error: ";
    for (auto line = result.last_lines.rbegin(); line != result.last_lines.rend(); ++line)
        if (const auto at = line->find(kMark); at != std::string::npos) return line->substr(at + kMark.size());
    return fmt::format("exit code {}{}", result.exit_code, result.last_lines.empty() ? "" : ": " + result.last_lines.back());
}

class SuiteRun {
  public:
    SuiteRun(std::string suite, fs::path folder, const std::vector<SuiteCell>& cells) : suite_(std::move(suite)), folder_(std::move(folder)) {
        for (const SuiteCell& cell : cells) lines_.push_back({cell, std::nullopt, ""});
    }

    void run() {
        catch_interrupts();
        std::error_code ignored; // the write reports what is wrong
        fs::create_directories(folder_, ignored);
        write();
        const bool cuda = uses_cuda(lines_.front().cell.options.device);
        std::vector<std::string> gpus = cuda ? visible_gpus() : std::vector<std::string>{""};
        std::vector<std::thread> workers;
        for (const std::string& gpu : gpus) workers.emplace_back([this, gpu, cuda] { work(gpu, cuda); });
        for (std::thread& worker : workers) worker.join();
        std::fputs(format_suite(lines_).c_str(), stdout);
        if (write_failure_) std::rethrow_exception(write_failure_);
        if (stopped_) throw Interrupted("interrupted; the same command trains what is missing in " + folder_.string());
        if (num_failed_ > 0)
            throw Error(exit_code_, fmt::format("{} of {} runs failed; the messages are in {}", num_failed_, lines_.size(), (folder_ / "suite.md").string()));
    }

  private:
    /// Takes one line after another until there is none.
    void work(const std::string& gpu, bool cuda) {
        for (;;) {
            std::size_t k;
            {
                const std::lock_guard lock(mutex_);
                if (next_ == lines_.size() || stopped_ || interrupted()) {
                    stopped_ = stopped_ || next_ < lines_.size();
                    return;
                }
                k = next_++;
            }
            ExitCode code = ExitCode::kOk;
            SuiteLine line = lines_[k]; // the only writer of this one
            try {
                code = train(line, k, gpu, cuda);
            } catch (const Error& e) {
                line.error = e.what(), code = e.code();
            } catch (const std::exception& e) {
                line.error = e.what(), code = ExitCode::kUnexpected;
            }
            finish(k, std::move(line), code);
        }
    }

    ExitCode train(SuiteLine& line, std::size_t k, const std::string& gpu, bool cuda) {
        const TrainOptions& options = line.cell.options;
        const std::string name = fmt::format("[{}/{}] {}, {}", k + 1, lines_.size(), line.cell.row, line.cell.appearance);
        if (!options.overwrite) line.result = finished_cell(line.cell);
        if (line.result) {
            spdlog::info("{}: finished before in {}", name, options.model);
            return ExitCode::kOk;
        }
        spdlog::info("{}: training in {}{}", name, options.model, cuda ? " on GPU " + gpu : "");
        const std::string config = options.model + ".yaml";
        write_text_atomic(config, options_to_yaml(options));
        std::vector<std::string> command = {fs::read_symlink("/proc/self/exe").string(), "train", "--config", config, "--time-frames",
                                            std::to_string(cuda ? kFrameRoundsCuda : kFrameRoundsCpu)};
        if (holds_same_run(line.cell.options)) command.push_back("--overwrite"); // anew: the time of a resumed run is not that of the training
        std::vector<std::pair<std::string, std::string>> environment;
        if (cuda) environment.push_back({"CUDA_VISIBLE_DEVICES", gpu});
        const ProcessResult result = run_process(command, environment, [&](const std::string& printed) { spdlog::debug("{}: {}", name, printed); });
        if (result.exit_code != 0) {
            line.error = error_of(result);
            return ExitCode(result.exit_code);
        }
        line.result = finished_cell(line.cell);
        if (line.result) {
            spdlog::info("{}: PSNR {:.2f}, {} Gaussians, {:.1f} s", name, line.result->psnr, line.result->num_gaussians, line.result->train_seconds);
            return ExitCode::kOk;
        }
        line.error = "no scores; does the scene have test views?";
        return ExitCode::kDataset;
    }

    void finish(std::size_t k, SuiteLine line, ExitCode code) {
        const std::lock_guard lock(mutex_);
        if (code == ExitCode::kInterrupted) {
            stopped_ = true;
            line.error.clear();
        } else if (!line.error.empty()) {
            spdlog::error("{}, {}: {}", line.cell.row, line.cell.appearance, line.error);
            if (num_failed_++ == 0) exit_code_ = code;
        }
        lines_[k] = std::move(line);
        try {
            write();
        } catch (...) { // a full disk stops the others, too
            stopped_ = true;
            write_failure_ = std::current_exception();
        }
    }

    void write() const { write_suite(folder_, suite_, lines_); }

    const std::string suite_;
    const fs::path folder_;
    std::mutex mutex_; ///< of all below
    std::vector<SuiteLine> lines_;
    std::size_t next_ = 0;
    bool stopped_ = false;
    std::exception_ptr write_failure_;
    int num_failed_ = 0;
    ExitCode exit_code_ = ExitCode::kOk;
};

}  // namespace

void run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base) {
    if (base.model.empty()) base.model = (fs::path("output") / (scene_name(base.source) + "-" + suite)).string();
    if (!base.resume.empty()) throw UsageError("--suite: runs are not resumed; the same command again trains those that are missing");
    if (std::find(appearances.begin(), appearances.end(), kAutoAppearance) != appearances.end())
        throw UsageError("--appearances: a suite compares models by name; auto would choose another one in every run");
    const std::vector<SuiteCell> cells = suite_cells(suite, appearances, base);
    if (cells.empty()) throw UsageError("--appearances: no appearance model named");
    SuiteRun(suite, base.model, cells).run();
}

}  // namespace gs
