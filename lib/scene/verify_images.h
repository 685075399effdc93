// SPDX-License-Identifier: Apache-2.0
// Decodes all images of a scene before training, so that damaged files are found before hours are spent.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "lib/scene/scene.h"

namespace gs {

/// Decodes every image and mask of the scene, on all threads. Training views that cannot be decoded are removed, with a
/// note. Images stay in memory (View::decoded), so that nothing is decoded twice: the training images if together they
/// fit into `keep_bytes`, and the test images too if they fit in the remainder. `progress` is called with the number
/// done and the total, from one thread at a time. Throws DataError if a test view cannot be decoded, because scores of
/// the other views alone would not be comparable, or if no training view can be decoded.
void verify_images(Scene& scene, std::size_t keep_bytes,
                   const std::function<void(std::int64_t, std::int64_t)>& progress);

}  // namespace gs
