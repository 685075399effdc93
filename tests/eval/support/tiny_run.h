// SPDX-License-Identifier: Apache-2.0
// A run folder as training leaves it: one red Gaussian in a built-in scene.
#pragma once

#include <string>

#include "lib/core/options.h"
#include "lib/model/ply.h"
#include "lib/model/run_folder.h"
#include "tests/core/temporary_folder.h"

namespace gs::test {

/// An opaque red ball in the middle of the built-in scenes, of model none.
inline Gaussians one_gaussian() {
    Gaussians g;
    g.count = 1;
    g.appearance = {"none", 0, ColorActivation::kRelu};
    g[Group::kMean] = {3, {0, 0, 0.3f}, {}, {}};
    g[Group::kScale] = {3, {-1.5f, -1.5f, -1.5f}, {}, {}};
    g[Group::kRotation] = {4, {1, 0, 0, 0}, {}, {}};
    g[Group::kOpacity] = {1, {5}, {}, {}};
    g[Group::kBase] = {3, {0.4f, -0.5f, -0.5f}, {}, {}};
    return g;
}

/// The same with a residual of spherical harmonics of degree 1, zero but for `band`.
inline Gaussians one_sh_gaussian(float band) {
    Gaussians g = one_gaussian();
    g.appearance = {"sh", 1, ColorActivation::kRelu};
    g.active_degree = 1;
    g[Group::kResidual] = {9, {band, 0, 0, 0, 0, 0, 0, 0, 0}, {}, {}};
    return g;
}

/// A folder with a configuration (40 pixels wide, on the CPU) and `model` after 100 iterations.
struct TinyRun {
    TemporaryFolder folder;
    TrainOptions options;

    explicit TinyRun(const Gaussians& model = one_gaussian(), bool eval = true) {
        options.source = "builtin:diffuse";
        options.model = (folder.path() / "run").string();
        options.resolution = 40;
        options.device = Device::kCpu;
        options.eval = eval;
        options.appearance = model.appearance.model;
        if (model.appearance.model == "sh") options.model_options["sh-degree"] = model.appearance.max_degree;
        options.background = {.color = {0, 0, 1}};
        options = resolve(options);
        write_ply(names().point_cloud(100), model, {.iteration = 100});
        folder.write("run/config.yaml", options_to_yaml(options));
    }
    std::filesystem::path path() const { return options.model; }
    RunFolder names() const { return {options.model}; }
};

}  // namespace gs::test
