// SPDX-License-Identifier: Apache-2.0
// Parses and formats backgrounds.
#include "lib/core/background.h"

#include <fmt/format.h>

#include <charconv>

namespace gs {

std::optional<Background> parse_background(const std::string& text) {
    if (text == "black") return Background{};
    if (text == "white") return Background::white();
    if (text == "random") return Background{.kind = Background::Kind::kRandom};
    Background background;
    float* const channels[] = {&background.color.x, &background.color.y, &background.color.z};
    std::size_t begin = 0;
    for (int channel = 0; channel < 3; ++channel) {
        const std::size_t end = channel < 2 ? text.find(',', begin) : text.size();
        if (end == std::string::npos) return std::nullopt;
        float& value = *channels[channel];
        const char* last = text.data() + end;
        const auto [stop, error] = std::from_chars(text.data() + begin, last, value);
        if (error != std::errc{} || stop != last || !(value >= 0 && value <= 1)) return std::nullopt;
        begin = end + 1;
    }
    return background;
}

std::string background_text(const Background& background) {
    if (background.random()) return "random";
    if (background.always(0, 0, 0)) return "black";
    if (background.always(1, 1, 1)) return "white";
    return fmt::format("{},{},{}", background.color.x, background.color.y, background.color.z);
}

}  // namespace gs
