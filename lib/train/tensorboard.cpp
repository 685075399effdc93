// SPDX-License-Identifier: Apache-2.0
// Chooses what of a training goes to its event file, and under which names.
#include "lib/train/tensorboard.h"

#include <algorithm>
#include <utility>

#include "kernels/base/error.h"
#include "kernels/state/gaussian_state.h"
#include "lib/core/log.h"

namespace gs {
namespace {

/// A number of the training log: the event and field it has there, and its name in TensorBoard.
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

void TensorBoard::add_rates(std::int64_t iteration, const StepRequest& rates) {
    std::vector<EventFile::Scalar> scalars;
    for (int g = 0; g < kNumGroups; ++g) {
        double rate = rates.rates[g];
        if (Group(g) == Group::kResidual && !rates.residual_rates.empty())
            rate = *std::max_element(rates.residual_rates.begin(), rates.residual_rates.end());
        if (rate > 0) scalars.push_back({std::string("rates/") + kGroupNames[std::size_t(g)], rate});
    }
    if (rates.shared_rate > 0) scalars.push_back({"rates/shared", rates.shared_rate});
    attempt([&] { file_.add(iteration, scalars); });
}

void TensorBoard::add_picture(std::int64_t iteration, const std::string& tag, const Image& picture) {
    attempt([&] { file_.add(iteration, tag, picture); });
}

}  // namespace gs
