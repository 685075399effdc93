// SPDX-License-Identifier: Apache-2.0
// Computes PSNR in double precision, summed row by row.
#include "eval/metrics/psnr.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "kernels/base/error.h"

namespace gs {

void require_same_size(const Image& a, const Image& b) {
    if (a.width == b.width && a.height == b.height && a.channels == b.channels && a.bytes() > 0 && b.bytes() > 0)
        return;
    throw UsageError(fmt::format("images to compare must be of one size and not empty: {}x{}x{} and {}x{}x{}", a.width,
                                 a.height, a.channels, b.width, b.height, b.channels));
}

double psnr(const Image& a, const Image& b) {
    require_same_size(a, b);
    double sum = 0;
    for (int y = 0; y < a.height; ++y) {
        double row = 0;
        for (int x = 0; x < a.width; ++x) {
            for (int c = 0; c < a.channels; ++c) {
                const double difference = double(a.value(x, y, c)) - double(b.value(x, y, c));
                row += difference * difference;
            }
        }
        sum += row;
    }
    if (sum == 0) return std::numeric_limits<double>::infinity();
    return -10 * std::log10(sum / (double(a.width) * a.height * a.channels));
}

}  // namespace gs
