// SPDX-License-Identifier: Apache-2.0
// Finds the image files that datasets name, in folders where names and extensions may differ a little.
#include "lib/scene/image_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <system_error>

#include "kernels/core/error.h"
#include "lib/core/input_file.h"

namespace gs {

namespace fs = std::filesystem;

bool has_image_extension(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return std::tolower(c); });
    return std::find(std::begin(kImageExtensions), std::end(kImageExtensions), extension) != std::end(kImageExtensions);
}

bool names_file(const fs::path& path) {
    std::error_code error;
    const fs::file_type type = fs::status(path, error).type();
    return error != std::errc::filename_too_long && type != fs::file_type::not_found &&
           type != fs::file_type::directory;
}

std::string without_extension(const std::string& name) {
    const std::string extension = fs::path(name).extension().string();
    return name.substr(0, name.size() - extension.size());
}

ImageFolder::ImageFolder(const fs::path& folder) : folder_(folder) {
    if (!folder_exists(folder)) return;
    list_folder(folder);  // throws for a folder that may not be opened, which the iterator passes over
    std::error_code error;
    for (fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error), end;
         !error && it != end; it.increment(error)) {
        std::error_code ignored;
        if (!it->is_directory(ignored) && has_image_extension(it->path()))
            names_.push_back(it->path().lexically_relative(folder).generic_string());
    }
    if (error) throw DataError(fmt::format("{}: cannot be listed: {}", folder.string(), error.message()));
    std::sort(names_.begin(), names_.end());
    for (const std::string& name : names_) by_stem_.emplace(without_extension(name), name);
}

std::optional<fs::path> ImageFolder::find(const std::string& name) const {
    const std::string normal = fs::path(name).lexically_normal().generic_string();
    if (std::binary_search(names_.begin(), names_.end(), normal)) return folder_ / normal;
    if (const auto it = by_stem_.find(without_extension(normal)); it != by_stem_.end()) return folder_ / it->second;
    return {};
}

}  // namespace gs
