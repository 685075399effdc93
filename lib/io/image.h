// SPDX-License-Identifier: Apache-2.0
// Images in memory and on disk. All decoding and encoding goes through OpenImageIO, which the first call loads
// (lib/io/image_module.h); every function here that reads or writes throws DeviceError where that fails.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace gs {

/// An interleaved (H,W,C) image. Exactly one of u8 and f32 is non-empty: 8-bit sources stay 8-bit, 16-bit and float
/// sources are float (16-bit integers divided by 65535). Alpha is straight (not premultiplied).
struct Image {
    int width = 0, height = 0, channels = 0;
    std::vector<std::uint8_t> u8;
    std::vector<float> f32;

    bool is_float() const { return !f32.empty(); }
    std::size_t bytes() const { return u8.size() + 4 * f32.size(); }
    /// Returns one value: in [0,1] for 8-bit data, as stored for float data.
    float value(int x, int y, int c) const {
        const std::size_t i = (std::size_t(y) * width + x) * channels + c;
        return is_float() ? f32[i] : u8[i] * (1.0f / 255.0f);
    }
};

/// Exposure settings in a file's metadata. Settings that are absent, zero, negative or not finite are empty.
struct ExifSettings {
    std::optional<double> seconds, iso, f_number;
};

struct ImageInfo {
    int width = 0, height = 0, channels = 0;
    bool float_data = false;  ///< read_image would return float
    int orientation = 1;      ///< EXIF tag 1..8, 1 where the file has none; `width` and `height` are those stored
    ExifSettings exposure;
};

/// Returns the 8-bit value of a channel: clamped to [0,1], *255, +0.5, truncated; 0 for NaN.
inline std::uint8_t to_8_bits(float value) {
    if (!(value > 0)) return 0;
    // The rule that metrics of other programs follow, too.
    return static_cast<std::uint8_t>(std::min(value, 1.0f) * 255.0f + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
}

/// Reads only the header. Throws DataError naming the file and the reason; zero and absurd sizes are errors. Throws
/// DeviceError naming the file where memory runs out.
ImageInfo read_image_info(const std::filesystem::path& path);

/// Reads PNG, JPEG, TIFF, WebP, EXR, ... as 3 (rgb) or 4 (rgba) channels. Grey is replicated, extra channels are
/// dropped, the EXIF orientation is ignored. Throws DataError naming the file and the decoder's reason, and DeviceError
/// as read_image_info does.
Image read_image(const std::filesystem::path& path);

/// Reads a mask as one 8-bit channel: alpha if it varies, else luma. The largest value says what full weight is: 1 in a
/// file of zeros and ones, 255 in a 16-bit file of 8-bit values, and otherwise white. Throws as read_image does.
Image read_mask(const std::filesystem::path& path);

/// Resizes with an area-exact box filter when shrinking, bilinearly when enlarging; premultiplies alpha while
/// filtering. Throws UsageError for a target size that is not positive.
Image resize_image(const Image& in, int width, int height);

/// Encodes in the format of the extension (png, jpg, exr, ...) and writes through an AtomicFile. For 8-bit formats
/// float data is quantised by clamp to [0,1], *255, +0.5, truncate (evaluation protocol). Throws DataError, also for
/// WebP with alpha and for formats other than PNG, JPEG, TIFF, EXR, WebP and BMP, which are those that are read.
void write_image(const std::filesystem::path& path, const Image& image);

/// Encodes an 8-bit rgb image as a JPEG file in memory, quality 1..100. Throws UsageError for other images, DataError
/// for sizes that JPEG cannot hold.
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);

}  // namespace gs
