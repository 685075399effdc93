// SPDX-License-Identifier: Apache-2.0
// Reads a log that another thread or program is writing.
#include "eval/live/course_log.h"

#include <sys/stat.h>

#include <cmath>
#include <fstream>
#include <string>

#include "lib/core/json_text.h"

namespace gs {

nlohmann::ordered_json Curve::json(std::size_t most) const {
    nlohmann::ordered_json x = nlohmann::ordered_json::array(), y = x;
    const std::size_t size = values.size(), step = (size + most - 1) / most;
    for (std::size_t k = 0; k < size; k += step) {
        // Counted from the end, so that the last value is always among them.
        const std::size_t i = (size - 1) % step + k;
        x.push_back(iterations[i]);
        y.push_back(std::isfinite(values[i]) ? nlohmann::ordered_json(values[i]) : nlohmann::ordered_json());
    }
    return {{"iterations", x}, {"values", y}};
}

void CourseLog::update() {
    struct stat status = {};
    if (::stat(file_.c_str(), &status) != 0) return;
    if (std::uintmax_t(status.st_ino) != inode_ || std::uintmax_t(status.st_size) < read_) *this = CourseLog(file_);
    inode_ = status.st_ino;
    if (std::uintmax_t(status.st_size) == read_) return;
    std::ifstream in(file_, std::ios::binary);
    in.seekg(std::streamoff(read_));
    for (std::string line; std::getline(in, line) && !in.eof(); read_ += line.size() + 1) read_line(line);
}

void CourseLog::read_line(const std::string& line) {
    const nlohmann::json json = try_parse_json(line);
    if (!json.is_object() || !json.contains("iteration") || !json["iteration"].is_number_integer()) return;
    const auto number = [&](const char* name) {
        const auto found = json.find(name);
        return found != json.end() && found->is_number() ? found->get<double>() : NAN;
    };
    const std::int64_t at = json["iteration"].get<std::int64_t>();
    const nlohmann::json event = json.value("event", nlohmann::json());
    if (event == "step") {
        loss_.add(at, number("loss"));
        iteration_ = at;
        if (const double n = number("num_gaussians"); std::isfinite(n)) num_gaussians_ = std::int64_t(n);
        if (const double s = number("train_seconds"); std::isfinite(s)) train_seconds_ = s;
    } else if (event == "target" || event == "evaluation") {
        psnr_.add(at, number("psnr"));
    }
}

}  // namespace gs
