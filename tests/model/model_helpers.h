// SPDX-License-Identifier: Apache-2.0
// Random models of any appearance for tests of file formats.
#pragma once

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "appearance/model_info.h"
#include "lib/model/appearance_spec.h"

namespace gs::test {

/// Whether the program was built with that model: without GSAPP_VARIANTS some are left out.
inline bool has_model(const std::string& name) {
    const std::vector<std::string> names = appearance_names();
    return std::find(names.begin(), names.end(), name) != names.end();
}

/// Gaussians with standard-normal parameters (and moments on request); the rotations are not normalised.
inline Gaussians random_gaussians(std::int64_t count, const AppearanceSpec& appearance, bool with_moments = false,
                                  unsigned seed = 1) {
    std::mt19937 random(seed);
    std::normal_distribution<float> normal;
    Gaussians g;
    g.count = count;
    g.appearance = appearance;
    g.active_degree = appearance.max_degree;
    for (int i = 0; i < kNumGroups; ++i) {
        GroupArrays<float>& group = g.groups[i];
        group.width = group_width(Group(i), appearance);
        const std::size_t n = std::size_t(count) * group.width;
        for (std::size_t k = 0; k < n; ++k) group.param.push_back(normal(random));
        for (std::size_t k = 0; with_moments && k < n; ++k) {
            group.m.push_back(normal(random));
            group.v.push_back(normal(random) * 1e-6f);
        }
    }
    g.shared.width = appearance_model(appearance.model).num_shared;
    for (int k = 0; k < g.shared.width; ++k) {
        g.shared.param.push_back(normal(random));
        if (with_moments) g.shared.m.push_back(normal(random)), g.shared.v.push_back(normal(random) * 1e-6f);
    }
    return g;
}

}  // namespace gs::test
