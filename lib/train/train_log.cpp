// SPDX-License-Identifier: Apache-2.0
// Writes stats/train.jsonl, and selects and names the values for the event file.
#include "lib/train/train_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sstream>
#include <utility>

#include "kernels/base/error.h"
#include "kernels/state/gaussian_state.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/io/atomic_file.h"
#include "lib/io/temporary.h"

namespace gs {
namespace {

/// A number of the training log: its event and field there, and its name in TensorBoard.
struct Shown {
    const char *event, *field, *tag;
};
constexpr Shown kShown[] = {{"step", "loss", "train/loss"},
                            {"step", "l1", "train/l1"},
                            {"step", "ssim", "train/ssim"},
                            {"step", "train_seconds", "train/seconds"},
                            {"step", "num_gaussians", "model/num_gaussians"},
                            {"evaluation", "psnr", "test/psnr"},
                            {"evaluation", "ssim", "test/ssim"},
                            {"target", "psnr", "held_out/psnr"},
                            {"target", "num_gaussians", "held_out/num_gaussians"}};

}  // namespace

TrainLog::TrainLog(const std::filesystem::path& path, std::int64_t iteration, bool at_end) : path_(path) {
    std::string kept;
    if (iteration > 0 && path_exists(path)) {
        std::istringstream in(read_input(path));
        for (std::string line; std::getline(in, line);) {
            const auto json = try_parse_json(line);  // a crash may have cut the last line short
            const bool numbered =
                json.is_object() && json.contains("iteration") && json["iteration"].is_number_integer();
            if (!numbered || json["iteration"] > iteration) continue;
            if (at_end && json["iteration"] == iteration && json.contains("final")) continue;
            kept += line + "\n";
            keep_reason(json);
        }
    }
    write_text_atomic(path, kept);
    fd_ = ::open(path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
    if (fd_ < 0) fail_to_write("open", path, errno);
}

TrainLog::~TrainLog() {
    if (fd_ < 0) return;
    flush();
    ::close(fd_);
}

/// Writes the pending lines. Returns the system's error number; 0 if all lines were written.
int TrainLog::flush() {
    while (!waiting_.empty()) {
        const ssize_t written = ::write(fd_, waiting_.data(), waiting_.size());
        if (written >= 0)
            waiting_.erase(0, std::size_t(written));
        else if (errno != EINTR)
            return errno;
    }
    return 0;
}

void TrainLog::keep_reason(const nlohmann::json& line) {
    const auto event = line.find("event"), reason = line.find("reason");
    if (event != line.end() && event->is_string() && reason != line.end() && reason->is_string())
        reasons_[*event] = *reason;
}

void TrainLog::write(const nlohmann::json& line) {
    keep_reason(line);
    waiting_ += json_text(line) + "\n";
    const int error = flush();  // at once, because other programs read the file during the run
    if (error == 0 || std::exchange(warned_, true)) return;
    log_warning("cannot write '{}': {}; the training goes on, and the lines are written when that is possible again",
                path_.string(), std::strerror(error));
}

void TrainLog::close() {
    int error = flush();
    if (::fsync(fd_) != 0 && errno != EINVAL && errno != ENOTSUP && error == 0) error = errno;
    if (::close(fd_) != 0 && error == 0) error = errno;
    fd_ = -1;
    if (error != 0) fail_to_write("write", path_, error);
}

void TensorBoard::attempt(const std::function<void()>& write) {
    try {
        write();
    } catch (const DataError& e) {
        if (!std::exchange(warned_, true))
            log_warning("{}; the training goes on without what is missing there", e.what());
    }
}

void TensorBoard::resume(std::int64_t iteration) {
    attempt([&] { file_.restart(iteration + 1); });
}

void TensorBoard::add_line(const nlohmann::json& line) {
    std::vector<EventFile::Scalar> scalars;
    for (const Shown& shown : kShown)
        if (line.at("event") == shown.event) scalars.push_back({shown.tag, line.at(shown.field).get<double>()});
    if (!scalars.empty()) attempt([&] { file_.add(line.at("iteration").get<std::int64_t>(), scalars); });
}

void TensorBoard::add_rates(std::int64_t iteration, const StepRates& rates) {
    std::vector<EventFile::Scalar> scalars;
    for (int g = 0; g < kNumGroups; ++g) {
        double rate = rates.groups[g];
        if (Group(g) == Group::kResidual && !rates.residuals.empty())
            rate = *std::max_element(rates.residuals.begin(), rates.residuals.end());
        if (rate > 0) scalars.push_back({std::string("rates/") + kGroupNames[std::size_t(g)], rate});
    }
    if (rates.shared > 0) scalars.push_back({"rates/shared", rates.shared});
    attempt([&] { file_.add(iteration, scalars); });
}

void TensorBoard::add_picture(std::int64_t iteration, const std::string& tag, const Image& picture) {
    attempt([&] { file_.add(iteration, tag, picture); });
}

}  // namespace gs
