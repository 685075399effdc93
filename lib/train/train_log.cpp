// SPDX-License-Identifier: Apache-2.0
// Writes stats/train.jsonl.
#include "lib/train/train_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <sstream>
#include <utility>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/io/atomic_file.h"
#include "lib/io/temporary.h"

namespace gs {

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
            if (json.contains("event") && json["event"] == "photometric" && json.contains("reason") &&
                json["reason"].is_string())
                photometric_reason_ = json["reason"];
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

/// Writes what is waiting. Returns the system's error, 0 if all is written.
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

void TrainLog::write(const nlohmann::json& line) {
    waiting_ += json_text(line) + "\n";
    const int error = flush();  // at once, because others read the file during the run
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

}  // namespace gs
