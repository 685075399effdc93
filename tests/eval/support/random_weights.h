// SPDX-License-Identifier: Apache-2.0
// Seeded images and files of weights for tests of metrics.
#pragma once

#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "lib/io/image.h"
#include "lib/io/safetensors.h"
#include "tests/kernels/random_values.h"

namespace gs::test {

/// Returns 8-bit rgb noise.
inline Image noise_image(int width, int height, std::uint64_t seed) {
    Image image{width, height, 3, {}, {}};
    for (const float v : random_values(std::size_t(width) * height * 3, seed, 0, 255.99f))
        image.u8.push_back(std::uint8_t(v));
    return image;
}

/// Tensors by name that are written to a file.
struct WeightFile {
    std::map<std::string, std::pair<std::vector<std::int64_t>, std::vector<float>>> tensors;

    /// Adds weights that keep activations near one through many layers.
    void add_layer(const std::string& name, int out, int in, int kernel, std::uint64_t seed) {
        const float bound = std::sqrt(6.0f / float(in * kernel * kernel));
        tensors[name + ".weight"] = {{out, in, kernel, kernel},
                                     random_values(std::size_t(out) * in * kernel * kernel, seed, -bound, bound)};
        tensors[name + ".bias"] = {{out}, random_values(out, seed + 1, -0.1f, 0.1f)};
    }

    void write(const std::filesystem::path& path) const {
        std::vector<TensorView> views;
        for (const auto& [name, tensor] : tensors)
            views.push_back({name, Dtype::kF32, tensor.first, tensor.second.data()});
        write_safetensors(path, views, {});
    }
};

}  // namespace gs::test
