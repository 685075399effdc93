// SPDX-License-Identifier: Apache-2.0
// Starts and watches the processes, and collects their results.
#include "eval/experiments/job_runner.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <iterator>
#include <mutex>
#include <set>
#include <sstream>
#include <system_error>
#include <thread>

#include "eval/experiments/job_claim.h"
#include "eval/runs/results.h"
#include "kernels/cuda/cuda_device.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/process.h"
#include "lib/core/run_config.h"
#include "lib/io/atomic_file.h"
#include "lib/model/run_folder.h"
#include "lib/train/choose_backend.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// Rounds through the test views for timing frames: about a second on a GPU; on the CPU one round takes as long.
constexpr int kFrameRoundsCuda = 20, kFrameRoundsCpu = 1;
/// Interval between two checks of the other processes' work.
constexpr std::chrono::milliseconds kLookEvery{500};

/// Returns the value of CUDA_VISIBLE_DEVICES for each GPU visible to this process.
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

/// Returns the error message of a failed program, from the last lines it printed.
std::string error_of(const ProcessResult& result) {
    static const std::string kMark = "error: ";
    for (auto line = result.last_lines.rbegin(); line != result.last_lines.rend(); ++line)
        if (const auto at = line->find(kMark); at != std::string::npos) return line->substr(at + kMark.size());
    return fmt::format("exit code {}{}", result.exit_code,
                       result.last_lines.empty() ? "" : ": " + result.last_lines.back());
}

class JobRunner {
  public:
    JobRunner(const std::vector<Job>& jobs, const JobHooks& hooks)
        : jobs_(jobs), hooks_(hooks), claims_(hooks.stale_after) {}

    JobsSummary run() {
        keep_finished();
        if (pending_.empty()) return summary_;
        const bool cuda = uses_cuda(jobs_.front().options.device);
        if (cuda && !cuda_available())
            throw DeviceError("option device: " + cuda_unavailable_reason() + "; use --device cpu");
        const std::vector<std::string> gpus = cuda ? visible_gpus() : std::vector<std::string>{""};
        std::vector<std::thread> workers;
        workers.reserve(gpus.size());
        for (const std::string& gpu : gpus) {
            try {
                workers.emplace_back([this, gpu, cuda] { work(gpu, cuda); });
            } catch (const std::system_error& e) {
                if (workers.empty()) throw;
                log_warning("GPU {} trains nothing: the system gives no thread for it: {}", gpu, e.what());
            }
        }
        for (std::thread& worker : workers) worker.join();
        if (hook_failure_) std::rethrow_exception(hook_failure_);
        return summary_;
    }

  private:
    void keep_finished() {
        for (std::size_t k = 0; k < jobs_.size(); ++k) {
            first_times_.push_back(result_time(k));
            first_failures_.push_back(read_note(failure_file(k)));
            JobOutcome outcome;
            if (!jobs_[k].options.overwrite) outcome.result = finished_job(jobs_[k].options);
            if (outcome.result) {
                log_info("{}: finished before in {}", name(k), jobs_[k].options.model);
                remove_old_claim(k);
                hooks_.done(k, outcome);
            } else {
                pending_.push_back(k);
            }
        }
    }

    struct Work {
        std::size_t job;
        std::unique_ptr<JobClaim> claim;
    };

    /// Trains jobs one after another until none is left.
    void work(const std::string& gpu, bool cuda) {
        while (const std::optional<Work> work = take()) {
            const std::size_t k = work->job;
            JobOutcome outcome;
            try {
                outcome = train(*work, gpu, cuda);
            } catch (const Error& e) {
                outcome.error = e.what(), outcome.code = e.code();
            } catch (const std::exception& e) {
                outcome.error = e.what(), outcome.code = ExitCode::kUnexpected;
            }
            // A run whose parent process was killed may still be running in the folder.
            if (!outcome.result && (work->claim->lost() || RunLock::is_held(jobs_[k].options.model) ||
                                    outcome.error.starts_with("another run")))
                leave_to_others(k);
            else
                finish(k, outcome);
        }
    }

    /// Returns the next job to train; waits if other processes work on all remaining jobs. Nothing if there is none.
    std::optional<Work> take() {
        for (;; std::this_thread::sleep_for(kLookEvery)) {
            const std::lock_guard lock(mutex_);
            try {
                note_others();
                while (!ends()) {
                    std::vector<std::size_t> free;
                    std::set_difference(pending_.begin(), pending_.end(), others_.begin(), others_.end(),
                                        std::back_inserter(free));
                    if (free.empty()) break;
                    const std::optional<std::size_t> k = hooks_.choose ? hooks_.choose(free) : free.front();
                    if (!k && others_.empty()) return std::nullopt;
                    if (!k) break;  // jobs of other processes may still yield a result
                    std::unique_ptr<JobClaim> claim = claims_.take(claim_file(*k));
                    if (!claim) {
                        others_.insert(*k);
                    } else if (!done_by_others(*k) && !failed_by_others(*k)) {
                        pending_.erase(std::find(pending_.begin(), pending_.end(), *k));
                        return Work{*k, std::move(claim)};
                    }
                }
            } catch (...) {
                hook_failure_ = std::current_exception();
            }
            if (ends()) return std::nullopt;
        }
    }

    bool ends() {
        summary_.interrupted = summary_.interrupted || interrupted();
        return pending_.empty() || summary_.interrupted || hook_failure_ || past_deadline();
    }

    /// Updates which pending jobs other processes work on, and which of these have finished. A live process that saw a
    /// job fail before this run_jobs call renews its note, so that the failure is accepted here, too.
    void note_others() {
        for (const std::size_t k : std::vector(pending_)) {
            if (failed_by_others(k)) continue;
            const bool held = claims_.held(claim_file(k)) || RunLock::is_held(jobs_[k].options.model) ||
                              claims_.held(failure_file(k));
            if (held && others_.insert(k).second) log_info("{}: another process works on it", name(k));
            if (!held && others_.erase(k) > 0 && done_by_others(k)) remove_old_claim(k);
        }
    }

    /// Accepts the failure of a job in another process since run_jobs was called.
    bool failed_by_others(std::size_t k) {
        const JobNote failure = read_note(failure_file(k));
        if (failure.text.empty() || failure == first_failures_[k]) return false;
        JobOutcome outcome;
        int code = 0;
        std::istringstream words(failure.text);
        words >> code >> std::ws;
        std::getline(words, outcome.error, '\0');
        outcome.code = ExitCode(code);
        pending_.erase(std::find(pending_.begin(), pending_.end(), k));
        others_.erase(k);
        log_error("{}: failed in another process: {}", jobs_[k].name, outcome.error);
        if (summary_.num_failed++ == 0) summary_.first_code = outcome.code;
        hooks_.done(k, outcome);
        return true;
    }

    /// Accepts the result of a job that another process finished since run_jobs was called.
    bool done_by_others(std::size_t k) {
        JobOutcome outcome;
        if (result_time(k) != first_times_[k]) outcome.result = finished_job(jobs_[k].options);
        if (!outcome.result) return false;
        pending_.erase(std::find(pending_.begin(), pending_.end(), k));
        log_info("{}: finished by another process", name(k));
        hooks_.done(k, outcome);
        return true;
    }

    /// Removes the claim that a killed process left for a finished job.
    void remove_old_claim(std::size_t k) {
        std::error_code ignored;
        if (!claims_.held(claim_file(k))) fs::remove(claim_file(k), ignored);
    }

    void leave_to_others(std::size_t k) {
        const std::lock_guard lock(mutex_);
        log_warning("{}: left to another process, which works on it too", name(k));
        pending_.insert(std::lower_bound(pending_.begin(), pending_.end(), k), k);
        others_.insert(k);
    }

    JobOutcome train(const Work& work, const std::string& gpu, bool cuda) const {
        const std::size_t k = work.job;
        const TrainOptions& options = jobs_[k].options;
        log_info("{}: training in {}{}", name(k), options.model, cuda ? " on GPU " + gpu : "");
        const std::string config = options.model + ".yaml";
        write_text_atomic(config, run_config(options));
        const fs::path program = hooks_.program.empty() ? fs::read_symlink("/proc/self/exe") : hooks_.program;
        std::vector<std::string> command = {
            program.string(), "train",         "--config",
            config,           "--time-frames", std::to_string(cuda ? kFrameRoundsCuda : kFrameRoundsCpu)};
        if (holds_same_run(options))
            command.push_back("--overwrite");  // starts over, because the plan measures the time of this call
        // However this process was started, the training is not a rank of a group.
        std::vector<std::pair<std::string, std::string>> environment = {{"RANK", "0"}, {"WORLD_SIZE", "1"}};
        if (cuda) environment.push_back({"CUDA_VISIBLE_DEVICES", gpu});
        const auto begin = Clock::now();
        const ProcessResult process = run_process(
            command, environment, [&](const std::string& printed) { log_debug("{}: {}", name(k), printed); },
            [&] { return interrupted() || past_deadline() || work.claim->lost(); });
        JobOutcome outcome;
        outcome.wall_seconds = std::chrono::duration<double>(Clock::now() - begin).count();
        outcome.code = ExitCode(process.exit_code);
        if (outcome.code == ExitCode::kOk) {
            outcome.result = finished_job(options);
            if (!outcome.result)
                outcome.error = "no scores; does the scene have test views?", outcome.code = ExitCode::kDataset;
        } else if (outcome.code != ExitCode::kInterrupted) {
            outcome.error = error_of(process);
        }
        return outcome;
    }

    void finish(std::size_t k, const JobOutcome& outcome) {
        const std::lock_guard lock(mutex_);
        if (outcome.result) {
            std::error_code ignored;
            fs::remove(failure_file(k), ignored);  // note of an earlier attempt
            log_info("{}: PSNR {:.2f}, {} Gaussians, {:.1f} s", name(k), outcome.result->psnr,
                     *outcome.result->num_gaussians, *outcome.result->train_seconds);
        } else if (!outcome.error.empty()) {
            log_error("{}: {}", jobs_[k].name, outcome.error);
            if (summary_.num_failed++ == 0) summary_.first_code = outcome.code;
            tell_failure(k, outcome);
        } else {
            log_warning("{}: stopped", name(k));
            if (!past_deadline()) summary_.interrupted = true;  // stopped by a signal, possibly sent only to the child
        }
        try {
            hooks_.done(k, outcome);
        } catch (...) {  // e.g. a full disk, which stops the other jobs, too
            hook_failure_ = std::current_exception();
        }
    }

    /// Notifies other processes that a job failed. If the note cannot be written, they will try the job, too.
    void tell_failure(std::size_t k, const JobOutcome& outcome) {
        try {
            failures_.push_back(claims_.tell(failure_file(k), fmt::format("{} {}", int(outcome.code), outcome.error)));
        } catch (const DataError& e) {
            log_warning("{}", e.what());
        }
    }

    /// Returns the time at which the results of a job were written; the minimum time if there are none.
    fs::file_time_type result_time(std::size_t k) const {
        std::error_code error;
        const fs::file_time_type time = fs::last_write_time(RunFolder{jobs_[k].options.model}.results(), error);
        return error ? fs::file_time_type::min() : time;
    }
    fs::path claim_file(std::size_t k) const { return jobs_[k].options.model + ".claim"; }
    fs::path failure_file(std::size_t k) const { return jobs_[k].options.model + ".failed"; }
    bool past_deadline() const { return hooks_.deadline && Clock::now() >= *hooks_.deadline; }
    std::string name(std::size_t k) const { return fmt::format("[{}/{}] {}", k + 1, jobs_.size(), jobs_[k].name); }

    const std::vector<Job>& jobs_;
    const JobHooks& hooks_;
    std::mutex mutex_;  ///< guards all members below
    JobClaims claims_;
    std::vector<std::size_t> pending_;                 ///< pending jobs in their order
    std::vector<fs::file_time_type> first_times_;      ///< times of results that existed at the start
    std::vector<JobNote> first_failures_;              ///< notes of failures that existed at the start
    std::vector<std::unique_ptr<JobClaim>> failures_;  ///< notes of jobs that failed here
    std::set<std::size_t> others_;                     ///< pending jobs that other processes work on
    std::exception_ptr hook_failure_;
    JobsSummary summary_;
};

}  // namespace

JobsSummary run_jobs(const std::vector<Job>& jobs, const JobHooks& hooks) { return JobRunner(jobs, hooks).run(); }

void throw_unless_complete(const JobsSummary& summary, std::size_t num_jobs, const fs::path& file) {
    if (summary.interrupted)
        throw Interrupted("interrupted; the same command trains what is missing in " + file.parent_path().string());
    if (summary.num_failed > 0)
        throw Error(summary.first_code, fmt::format("{} of {} runs failed; the messages are in {}", summary.num_failed,
                                                    num_jobs, file.string()));
}

}  // namespace gs
