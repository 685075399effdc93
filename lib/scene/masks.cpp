// SPDX-License-Identifier: Apache-2.0
// Finds the masks of a dataset and applies them to views.
#include "lib/scene/masks.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "lib/core/input_file.h"
#include "lib/io/orientation.h"
#include "lib/scene/image_files.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns `image` with `channels` channels: surplus ones are cut, missing ones are filled with full alpha.
Image with_channels(const Image& image, int channels) {
    Image out = image;
    out.channels = channels;
    const std::size_t pixels = std::size_t(image.width) * image.height;
    const auto repack = [&](const auto& from, auto& to, auto full) {
        to.assign(pixels * channels, full);
        for (std::size_t p = 0; p < pixels; ++p)
            for (int c = 0; c < std::min(channels, image.channels); ++c)
                to[p * channels + c] = from[p * image.channels + c];
    };
    if (image.is_float())
        repack(image.f32, out.f32, 1.0f);
    else
        repack(image.u8, out.u8, std::uint8_t(255));
    return out;
}

}  // namespace

std::optional<MaskFile> find_mask(const fs::path& scene, const std::string& image_name, const fs::path& image_path,
                                  int factor) {
    std::vector<fs::path> folders;
    if (factor > 1) folders.push_back(scene / fmt::format("masks_{}", factor));
    for (const char* name : {"masks", "mask", "sfm_masks"}) folders.push_back(scene / name);
    const std::string stem = without_extension(image_name);
    std::vector<std::string> names{image_name + ".png", image_name, stem + ".png", stem + ".mask.png"};
    for (const std::string_view extension : kImageExtensions) names.push_back(stem + std::string(extension));
    for (const fs::path& folder : folders) {
        if (!folder_exists(folder)) continue;
        for (const std::string& name : names)
            if (names_file(folder / name)) return MaskFile{folder / name, false};
    }
    for (const std::string_view extension : kImageExtensions) {
        const fs::path beside =
            image_path.parent_path() / fmt::format("dynamic_mask_{}{}", image_path.stem().string(), extension);
        if (names_file(beside)) return MaskFile{beside, true};
    }
    return {};
}

Image load_mask(const MaskFile& file, bool invert, int width, int height, int turn) {
    Image stored = read_mask(file.path);
    if (is_quarter_turn(turn) && (stored.width > stored.height) != (width > height))
        stored = upright(std::move(stored), turn);
    Image mask = resize_image(stored, width, height);
    if (invert != file.inverted)
        for (std::uint8_t& v : mask.u8) v = 255 - v;
    return mask;
}

ViewImage combine(Image color, std::optional<Image> mask, AlphaMode alpha_mode, MaskMode mask_mode) {
    const std::size_t pixels = std::size_t(color.width) * color.height;
    if (alpha_mode == AlphaMode::kMask && color.channels == 4) {
        Image alpha;
        alpha.width = color.width;
        alpha.height = color.height;
        alpha.channels = 1;
        alpha.u8.resize(pixels);
        for (std::size_t p = 0; p < pixels; ++p) {
            const float a = color.is_float() ? color.f32[4 * p + 3] : color.u8[4 * p + 3] / 255.0f;
            alpha.u8[p] = to_8_bits(mask ? a * mask->u8[p] / 255.0f : a);
        }
        mask = std::move(alpha);
        color = with_channels(color, 3);
    }
    if (mask_mode == MaskMode::kTransparent && mask) {
        if (color.channels == 3) color = with_channels(color, 4);
        for (std::size_t p = 0; p < pixels; ++p) {
            const float weight = mask->u8[p] / 255.0f;
            if (color.is_float())
                color.f32[4 * p + 3] *= weight;
            else
                color.u8[4 * p + 3] = to_8_bits(color.u8[4 * p + 3] / 255.0f * weight);
        }
        mask.reset();
    }
    return {std::move(color), std::move(mask)};
}

}  // namespace gs
