// SPDX-License-Identifier: Apache-2.0
// The image module, libgsapp_images.so (lib/images). It alone is linked with OpenImageIO, whose many libraries take
// longer to load than a command without images takes to run. So the module is loaded when the first image is opened.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "lib/io/image.h"
#include "lib/io/image_claim.h"

namespace gs {

/// An image file to open: the claim of its first bytes, and check_image_claim for the values that the decoder finds.
struct ImageSource {
    std::filesystem::path path;
    ImageClaim claim;
    void (*check)(const std::filesystem::path& path, const ImageClaim& claim, double decoded_bytes);
};

/// The functions of the module. They throw as the functions of lib/io/image.h do, and std::bad_alloc if memory runs
/// out.
struct ImageModule {
    /// Implementations of read_image_info and read_image.
    ImageInfo (*read_info)(const ImageSource& source);
    Image (*read)(const ImageSource& source);
    /// Returns the encoded file in the format of the path's extension, as described at write_image.
    std::vector<std::uint8_t> (*encode)(const std::filesystem::path& path, const Image& image);
    std::vector<std::uint8_t> (*encode_jpeg)(const Image& image, int quality);
    /// Returns the encoded upright copy of `from` (write_upright_copy), whose pixels must be complete. For a TIFF
    /// writes directly to `to` and returns an empty vector.
    std::vector<std::uint8_t> (*encode_upright)(const std::filesystem::path& from, const std::filesystem::path& to,
                                                int orientation);
};

/// Returns the module. The first call, from any thread, loads it. Throws DeviceError naming its file and the reason.
const ImageModule& image_module();

}  // namespace gs
