// SPDX-License-Identifier: Apache-2.0
// Decodes all images of a scene before the training, so that what is damaged shows before hours are spent.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "lib/scene/scene.h"

namespace gs {

/// Decodes every image and mask of the scene, on all threads. Training views that cannot be decoded are removed, with a
/// note. Images stay in memory (View::decoded), so that nothing is decoded twice: those of the training views if they
/// fit into `keep_bytes` together, those of the test views as well if these fit beside them. `progress` gets the number
/// done and the total, from one thread at a time. Throws DataError if a test view cannot be decoded, because scores of
/// the others would not compare, or if no training view can be.
void verify_images(Scene& scene, std::size_t keep_bytes,
                   const std::function<void(std::int64_t, std::int64_t)>& progress);

}  // namespace gs
