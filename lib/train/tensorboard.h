// SPDX-License-Identifier: Apache-2.0
// Shows the course of a training in TensorBoard.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "kernels/requests.h"
#include "lib/io/event_file.h"

namespace gs {

/// The event file of one run, or of the part of it that follows a resume. What cannot be written later on is a warning,
/// once: the training goes on.
class TensorBoard {
  public:
    /// Throws DataError where there can be no event file in `folder`.
    explicit TensorBoard(const std::filesystem::path& folder) : file_(folder) {}

    /// The run continues after `iteration`: what an earlier file has beyond it no longer counts.
    void resume(std::int64_t iteration);
    /// Takes the numbers of a line of stats/train.jsonl, if it has any to show.
    void add_line(const nlohmann::json& line);
    /// Adds the learning rates of a step; of a residual with several the highest.
    void add_rates(std::int64_t iteration, const StepRequest& rates);
    void add_picture(std::int64_t iteration, const std::string& tag, const Image& picture);

  private:
    void attempt(const std::function<void()>& write);

    EventFile file_;
    bool warned_ = false;
};

}  // namespace gs
