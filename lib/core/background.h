// SPDX-License-Identifier: Apache-2.0
// The background colour behind the scene, and its text in options and files.
#pragma once

#include <optional>
#include <string>

#include "kernels/base/vec.h"

namespace gs {

struct Background {
    enum class Kind { kFixed, kRandom };
    Kind kind = Kind::kFixed;    ///< kRandom: training draws a new colour in every iteration
    Vec3<float> color{0, 0, 0};  ///< RGB in [0,1]; black if random, because evaluation needs one fixed colour

    static Background white() { return {.color = {1, 1, 1}}; }

    bool random() const { return kind == Kind::kRandom; }
    /// Returns whether every iteration has this colour.
    bool always(float r, float g, float b) const { return !random() && color.x == r && color.y == g && color.z == b; }
};

/// The values that parse_background accepts, in words.
inline constexpr const char* kBackgroundValues = "black, white, random, or R,G,B with numbers in 0..1";

/// Parses "black", "white", "random" or "R,G,B" with numbers in [0,1]. Returns nothing for any other text.
std::optional<Background> parse_background(const std::string& text);

/// Returns the shortest text from which parse_background restores the same background.
std::string background_text(const Background& background);

}  // namespace gs
