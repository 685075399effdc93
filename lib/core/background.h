// SPDX-License-Identifier: Apache-2.0
// The colour behind the scene, as options and files name it.
#pragma once

#include <optional>
#include <string>

#include "kernels/base/vec.h"

namespace gs {

struct Background {
    enum class Kind { kFixed, kRandom };
    Kind kind = Kind::kFixed;    ///< kRandom: training draws a new colour in every iteration
    Vec3<float> color{0, 0, 0};  ///< in [0,1]; black where random, because evaluation needs one fixed colour

    static Background white() { return {.color = {1, 1, 1}}; }

    bool random() const { return kind == Kind::kRandom; }
    /// Whether every iteration has this one colour.
    bool always(float r, float g, float b) const { return !random() && color.x == r && color.y == g && color.z == b; }
};

/// What parse_background reads, in words.
inline constexpr const char* kBackgroundValues = "black, white, random, or R,G,B with numbers in 0..1";

/// Reads "black", "white", "random" or "R,G,B" with numbers in [0,1]; empty for any other text.
std::optional<Background> parse_background(const std::string& text);

/// The shortest text that parse_background reads back to the same background.
std::string background_text(const Background& background);

}  // namespace gs
