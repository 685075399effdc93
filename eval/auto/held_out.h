// SPDX-License-Identifier: Apache-2.0
// Which training views are held out where test views must not be looked at.
#pragma once

#include <cstddef>

namespace gs {

/// Every n-th training view is held out, beginning in the middle of the first n.
inline constexpr std::size_t kHeldOutEvery = 8;
inline bool is_held_out(std::size_t view) { return view % kHeldOutEvery == kHeldOutEvery / 2; }
/// With fewer training views than this none can be held out.
inline constexpr std::size_t kFewestViews = kHeldOutEvery;

}  // namespace gs
