// SPDX-License-Identifier: Apache-2.0
// The curves of a training, from the log that it writes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

namespace gs {

/// Values by iteration.
struct Curve {
    std::vector<std::int64_t> iterations;
    std::vector<double> values;

    void add(std::int64_t iteration, double value) {
        iterations.push_back(iteration);
        values.push_back(value);
    }
    /// Returns {"iterations": [...], "values": [...]} with at most about `most` points, the last among them. Values
    /// that are not finite are null.
    nlohmann::ordered_json json(std::size_t most) const;
};

/// Follows stats/train.jsonl while it grows.
class CourseLog {
  public:
    explicit CourseLog(std::filesystem::path file) : file_(std::move(file)) {}

    /// Reads the lines that have come since the last call. A file that replaced the one before is read from its
    /// beginning. Lines that are no JSON object with an iteration are skipped.
    void update();

    const Curve& loss() const { return loss_; }
    /// The PSNR of held-out views, dB: of test views, or of those for --target-psnr.
    const Curve& psnr() const { return psnr_; }
    /// What the last line of the training said; 0 before the first.
    std::int64_t iteration() const { return iteration_; }
    std::int64_t num_gaussians() const { return num_gaussians_; }
    double train_seconds() const { return train_seconds_; }

  private:
    void read_line(const std::string& line);

    std::filesystem::path file_;
    std::uintmax_t read_ = 0;  ///< bytes
    std::uintmax_t inode_ = 0;
    Curve loss_, psnr_;
    std::int64_t iteration_ = 0, num_gaussians_ = 0;
    double train_seconds_ = 0;
};

}  // namespace gs
