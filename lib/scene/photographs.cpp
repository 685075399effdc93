// SPDX-License-Identifier: Apache-2.0
// Looks through a folder of photographs and turns those that lie on their side.
#include "lib/scene/photographs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/interrupt.h"
#include "lib/io/atomic_file.h"
#include "lib/io/image.h"
#include "lib/io/orientation.h"
#include "lib/scene/image_files.h"
#include "lib/scene/masks.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Makes a link, or a copy on file systems without links (exFAT, network folders). Throws DataError.
void link_or_copy(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::create_symlink(fs::canonical(from), to, error);
    if (error) copy_file_atomic(from, to);
}

}  // namespace

Photographs find_photographs(const fs::path& images) {
    std::error_code error;
    Photographs found;
    for (fs::recursive_directory_iterator it(images, error), end; !error && it != end; it.increment(error)) {
        if (std::error_code ignored; !it->is_regular_file(ignored)) continue;
        const fs::path name = it->path().lexically_relative(images);
        // Side files, as "1.jpg_original" of exiftool and raw photographs, may have an orientation, too.
        if (has_image_extension(name))
            found.names.push_back(name.generic_string());
        else
            found.others.push_back(name);
    }
    if (error) throw DataError(fmt::format("{}: cannot be read: {}", images.string(), error.message()));
    const MaskFinder finder(images, found.names, 1);
    const auto masks = std::stable_partition(found.names.begin(), found.names.end(),
                                             [&](const std::string& name) { return !finder.is_mask(name); });
    found.masks.assign(masks, found.names.end());
    found.names.erase(masks, found.names.end());
    for (const std::string& name : found.names) {
        bool turned = false;
        try {
            const ImageInfo info = read_image_info(images / name);
            turned = info.orientation != 1;
            found.stored_sizes.insert({info.width, info.height});
            const bool quarter = is_quarter_turn(info.orientation);
            found.upright_sizes.insert({quarter ? info.height : info.width, quarter ? info.width : info.height});
        } catch (const DataError&) {
            // colmap skips what it cannot read, too.
        }
        (turned ? found.turned : found.others).push_back(name);
    }
    std::vector<std::string> facts;
    ImageFolder(images).tell_unread(found.notes, facts);
    if (found.stored_sizes.empty())
        throw DataError(fmt::format("{}: no photographs found{}{}", images.string(), found.notes.empty() ? "" : "; ",
                                    fmt::join(found.notes, "; ")));
    std::sort(found.names.begin(), found.names.end());
    return found;
}

void write_upright(const fs::path& images, const Photographs& photographs, const fs::path& folder) {
    for (const auto* names : {&photographs.turned, &photographs.others})
        for (const fs::path& name : *names) fs::create_directories((folder / name).parent_path());
    for (const fs::path& name : photographs.others)
        if (!interrupted()) link_or_copy(images / name, folder / name);
    parallel_for(std::int64_t(photographs.turned.size()), [&](std::int64_t i) {
        if (!interrupted()) write_upright_copy(images / photographs.turned[i], folder / photographs.turned[i]);
    });
    if (interrupted()) throw Interrupted("stopped while photographs were turned upright");
}

}  // namespace gs
