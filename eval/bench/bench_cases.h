// SPDX-License-Identifier: Apache-2.0
// The measurements of `gsapp bench`: one model on one scene, and generated sets.
#pragma once

#include <cstdint>
#include <string>

#include "eval/bench/bench.h"

namespace gs {

/// Returns how often things are measured on `device`; 0 leaves a number to the device. A GPU needs many short steps for
/// one good number, and on the CPU the same number of steps would take minutes.
BenchOptions bench_options(Device device, int repeat, int frame_repeat);

/// Runs run_bench. With `compare_deterministic` also times iterations with the other setting of --deterministic, on a
/// backend of its own.
BenchResult bench_model(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                        const BenchOptions& bench, bool compare_deterministic);

/// Measures a generated set (eval/bench/generated_set.h) of `count` Gaussians as bench_model does. `backend` is of the
/// options' appearance.
BenchResult bench_generated(Backend& backend, const TrainOptions& options, std::int64_t count,
                            const BenchOptions& bench, bool compare_deterministic);

}  // namespace gs
