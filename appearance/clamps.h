// SPDX-License-Identifier: Apache-2.0
// Upper limits on raw parameters that let a parameter come back (docs/math/appearance.md#clamps).
#pragma once

#include "kernels/base/portable.h"

namespace gs::appearance {

/// Returns min(raw, limit). NaN stays NaN, which gs_min(raw, limit) would turn into the limit.
template <class T> GS_HD T at_most(T raw, T limit) { return gs_min(limit, raw); }
template <class T> GS_HD T at_least(T raw, T limit) { return gs_max(limit, raw); }

/// The gradient of a parameter behind at_most: 0 only where the optimizer would raise it further. With 0 on the whole
/// flat part a parameter that once overshot could never return.
template <class T> GS_HD T gradient_at_most(T gradient, T raw, T limit) {
    return raw >= limit && gradient < T(0) ? T(0) : gradient;
}
template <class T> GS_HD T gradient_at_least(T gradient, T raw, T limit) {
    return raw <= limit && gradient > T(0) ? T(0) : gradient;
}

}  // namespace gs::appearance
