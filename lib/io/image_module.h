// SPDX-License-Identifier: Apache-2.0
// The module for images, libgsapp_images.so (lib/images). It alone is linked with OpenImageIO, whose many libraries
// take longer to load than all that a command without images does. So it is loaded when the first image is opened.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "lib/io/image.h"
#include "lib/io/image_claim.h"

namespace gs {

/// An image file to be opened: what its first bytes claim, and check_image_claim for what the decoder finds.
struct ImageSource {
    std::filesystem::path path;
    ImageClaim claim;
    void (*check)(const std::filesystem::path& path, const ImageClaim& claim, double decoded_bytes);
};

/// The functions of the module. They throw as those of lib/io/image.h, and std::bad_alloc for want of memory.
struct ImageModule {
    /// As read_image_info and read_image.
    ImageInfo (*read_info)(const ImageSource& source);
    Image (*read)(const ImageSource& source);
    /// Returns the bytes of a file in the format of the path's extension, as write_image describes it.
    std::vector<std::uint8_t> (*encode)(const std::filesystem::path& path, const Image& image);
    std::vector<std::uint8_t> (*encode_jpeg)(const Image& image, int quality);
    /// Returns the bytes of an upright copy of `from` (write_upright_copy), whose pixels are known to be whole. Writes
    /// a TIFF to `to` itself, and returns nothing then.
    std::vector<std::uint8_t> (*encode_upright)(const std::filesystem::path& from, const std::filesystem::path& to,
                                                int orientation);
};

/// Returns the module. The first call loads it, in whichever thread. Throws DeviceError naming its file and the reason.
const ImageModule& image_module();

}  // namespace gs
