// SPDX-License-Identifier: Apache-2.0
// Finds the masks of a dataset and applies them to views.
#include "lib/scene/masks.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "lib/core/input_file.h"
#include "lib/core/utf8.h"
#include "lib/io/image.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns `image` with `channels` channels: extra channels are dropped, and missing ones are filled with full alpha.
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

std::optional<std::string> masked_by(const std::string& name) {
    const std::string stem = without_extension(name), end = case_folded(fs::path(stem).extension().string());
    if (end != ".mask") return {};
    return without_extension(stem);
}

MaskFinder::Index::Index(const fs::path& path, const std::vector<std::string>& files) : folder(path) {
    for (const std::string& name : files) names.emplace(case_folded(without_extension(name)), name);
}

std::optional<fs::path> MaskFinder::Index::find(const std::string& stem, const std::string& preferred) const {
    const auto [begin, end] = names.equal_range(case_folded(stem));
    const std::string* best = nullptr;
    std::size_t least = 0;
    for (auto it = begin; it != end; ++it) {
        const std::string& name = it->second;
        const auto extension = std::find(std::begin(kImageExtensions), std::end(kImageExtensions),
                                         case_folded(fs::path(name).extension().string()));
        const std::size_t rank = (without_extension(name) != stem ? 1000 : 0) + (name != preferred ? 100 : 0) +
                                 std::size_t(extension - std::begin(kImageExtensions));
        if (best && rank >= least) continue;
        best = &name;
        least = rank;
    }
    if (!best) return {};
    return folder / *best;
}

MaskFinder::MaskFinder(const fs::path& root, const std::vector<std::string>& names, int factor)
    : root_(root.empty() ? "." : root), factor_(factor) {
    for (const std::string& name : names) {
        names_.insert(case_folded(name));
        stems_.insert(case_folded(without_extension(name)));
        std::string child;
        for (fs::path folder = fs::path(name).parent_path();; folder = folder.parent_path()) {
            children_[folder.generic_string()].insert(child);
            if (folder == folder.parent_path()) break;
            child = folder.filename().string();
        }
    }
}

bool MaskFinder::is_mask(const std::string& name) const {
    const std::optional<std::string> image = masked_by(name);
    return image && (names_.contains(case_folded(*image)) || stems_.contains(case_folded(*image)));
}

std::vector<MaskFinder::Index>& MaskFinder::mask_folders(const fs::path& place) {
    const auto [it, is_new] = mask_folders_.try_emplace(place);
    if (!is_new || !folder_exists(place)) return it->second;
    std::vector<std::string> names{"masks", "mask", "sfm_masks"};
    if (factor_ > 1) names.insert(names.begin(), fmt::format("masks_{}", factor_));
    for (const std::string& name : names)
        for (const fs::path& folder : entries_named(place, name))
            if (folder_exists(folder)) it->second.emplace_back(folder, ImageFolder(folder).names());
    return it->second;
}

const MaskFinder::Index& MaskFinder::beside(const fs::path& folder) {
    if (const auto it = beside_.find(folder); it != beside_.end()) return it->second;
    std::vector<std::string> files;
    for (const fs::path& file : list_folder(folder)) {
        const std::string name = file.filename().string();
        const std::string relative = (folder.lexically_relative(root_) / name).lexically_normal().generic_string();
        if (case_folded(name).find("mask") == std::string::npos || !has_image_extension(file)) continue;
        if (!stems_.contains(case_folded(without_extension(relative))) || is_mask(relative)) files.push_back(name);
    }
    return beside_.emplace(folder, Index(folder, files)).first->second;
}

std::optional<MaskFile> MaskFinder::find(const std::string& name, const std::string& inner,
                                         const fs::path& image_path) {
    // The folders that may contain a mask folder, each with the image's name below it.
    std::vector<std::pair<fs::path, std::string>> places{{root_, inner}, {root_, name}};
    for (fs::path folder = fs::path(name).parent_path(); folder.has_filename() && folder.filename() != "..";
         folder = folder.parent_path()) {
        const fs::path above = folder.parent_path();
        // If the folder had siblings, the masks could belong to any of them.
        if (children_[above.generic_string()].size() == 1)
            places.emplace_back(root_ / above, fs::path(name).lexically_relative(folder).generic_string());
    }
    const auto with_mask = [](const std::string& stem) { return std::vector{stem + ".mask", stem + "_mask"}; };
    for (const auto& [place, below] : places)
        for (Index& folder : mask_folders(place))
            for (const std::string& stem : {below, without_extension(below)}) {
                std::vector<std::string> stems = with_mask(stem);
                stems.insert(stems.begin(), stem);
                for (const std::string& candidate : stems) {
                    const std::optional<fs::path> found = folder.find(candidate, below);
                    if (!found) continue;
                    folder.used = true;
                    return MaskFile{*found, false};
                }
            }
    const Index& neighbours = beside(image_path.parent_path());
    const std::string file = image_path.filename().string(), stem = without_extension(file);
    for (const std::string& base : {file, stem})
        for (const std::string& candidate : with_mask(base))
            if (const auto found = neighbours.find(candidate, "")) return MaskFile{*found, false};
    if (const auto found = neighbours.find("dynamic_mask_" + stem, "")) return MaskFile{*found, true};
    return {};
}

std::vector<fs::path> MaskFinder::unused() const {
    std::vector<fs::path> folders;
    for (const auto& [place, indices] : mask_folders_)
        for (const Index& index : indices)
            if (!index.used && !index.names.empty()) folders.push_back(index.folder);
    return folders;
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
