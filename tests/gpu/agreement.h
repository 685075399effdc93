// SPDX-License-Identifier: Apache-2.0
// A backend against the reference in double: every number within its error bound, and the worst case printed.
#pragma once

#include "tests/gpu/reference.h"
#include "tests/gpu/scenes.h"

namespace gs::test {

/// Compares one quantity: worst error / bound over all its numbers.
class Agreement {
  public:
    explicit Agreement(std::string what) : what_(std::move(what)) {}

    void add(double value, Rounded reference) {
        const double error = std::abs(value - reference.v);
        if (!(error <= reference.e)) {
            if (beyond_++ == 0) first_ = std::int64_t(bounds_.size());
            if (!(error <= beyond_error_)) beyond_error_ = error;
        }
        const double ratio = reference.e > 0 ? error / reference.e : (error == 0 ? 0 : INFINITY);
        if (!(ratio <= ratio_)) ratio_ = ratio, error_ = error;
        scale_ = std::max(scale_, std::abs(reference.v));
        bounds_.push_back(reference.e);
    }
    /// Prints the worst ratio. Fails where more numbers than the share `beyond` exceed their bounds, where one of them
    /// is off by more than a hundredth of the largest value, or where half of the bounds are too large to say anything.
    void expect(double rounding_share, double beyond = 0) {
        if (bounds_.empty()) return;
        std::vector<double> sorted = bounds_;
        std::nth_element(sorted.begin(), sorted.begin() + std::ptrdiff_t(sorted.size() / 2), sorted.end());
        const double median = sorted[sorted.size() / 2];
        std::printf(
            "  %-22s worst error/bound %.4f (error %.1e); largest value %.1e, half of the bounds below %.1e; %lld of "
            "%zu beyond\n",
            what_.c_str(), ratio_, error_, scale_, median, (long long)beyond_, bounds_.size());
        EXPECT_LE(beyond_, std::int64_t(beyond * double(bounds_.size())))
            << what_ << ": of " << bounds_.size() << " numbers, the first at " << first_;
        EXPECT_LE(beyond_error_, 0.01 * scale_) << what_;
        if (scale_ > 0) {
            EXPECT_LE(median, rounding_share * scale_) << what_ << ": bounds that say nothing";
        }
    }

  private:
    std::string what_;
    std::vector<double> bounds_;
    std::int64_t beyond_ = 0, first_ = -1;
    double ratio_ = -1, error_ = 0, scale_ = 0, beyond_error_ = 0;
};

/// Renders all three modes and expects errors within bounds.
void expect_images_within_bounds(Backend& backend, const TestScene& scene);

/// Takes one step from zero moments and expects loss, moments, parameters and statistic within bounds.
void expect_step_within_bounds(const std::vector<Backend*>& backends, const TestScene& scene);

}  // namespace gs::test
