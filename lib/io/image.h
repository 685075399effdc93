// SPDX-License-Identifier: Apache-2.0
// Images in memory and on disk, and functions that turn photographs upright. All decoding and encoding goes through
// OpenImageIO, which the first call loads (lib/io/image_module.h). Every function here that reads or writes throws
// DeviceError if loading fails.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
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
    /// Returns one value: in [0,1] for 8-bit data, and the stored value for float data.
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
    int orientation = 1;      ///< EXIF tag 1..8, 1 if the file has none; `width` and `height` are as stored
    ExifSettings exposure;
};

/// Returns the 8-bit value of a channel: clamped to [0,1], *255, +0.5, truncated; 0 for NaN.
inline std::uint8_t to_8_bits(float value) {
    if (!(value > 0)) return 0;
    // Metrics of other programs follow the same rule.
    return static_cast<std::uint8_t>(std::min(value, 1.0f) * 255.0f + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
}

/// Reads only the header. Throws DataError naming the file and the reason; zero and absurd sizes are errors. Throws
/// DeviceError naming the file if memory runs out.
ImageInfo read_image_info(const std::filesystem::path& path);

/// Reads PNG, JPEG, TIFF, WebP, EXR, ... as 3 (rgb) or 4 (rgba) channels. Grey is replicated, extra channels are
/// dropped, the EXIF orientation is ignored. Throws DataError naming the file and the decoder's reason, and DeviceError
/// as read_image_info does.
Image read_image(const std::filesystem::path& path);

/// Reads a mask as one 8-bit channel: alpha if it varies, else luma. The largest value determines full weight: 1 in a
/// file of zeros and ones, 255 in a 16-bit file of 8-bit values, and otherwise white. Throws as read_image does.
Image read_mask(const std::filesystem::path& path);

/// Resizes with an area-exact box filter when shrinking, bilinearly when enlarging; premultiplies alpha while
/// filtering. Throws UsageError for a target size that is not positive.
Image resize_image(const Image& in, int width, int height);

/// Encodes in the format of the extension (png, jpg, exr, ...) and writes through an AtomicFile. For 8-bit formats
/// float data is quantised by clamp to [0,1], *255, +0.5, truncate (evaluation protocol). Throws DataError, also for
/// WebP with alpha and for formats other than the readable ones: PNG, JPEG, TIFF, EXR, WebP and BMP.
void write_image(const std::filesystem::path& path, const Image& image);

/// Encodes an 8-bit rgb image as a JPEG file in memory, quality 1..100. Throws UsageError for other images, DataError
/// for sizes that JPEG cannot hold.
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);

/// Returns true for the EXIF orientations that exchange width and height.
constexpr bool is_quarter_turn(int orientation) { return orientation >= 5; }

/// Returns the pixels, of `bytes` each, turned and mirrored according to the EXIF orientation 1..8. OpenImageIO 2.4 has
/// such a function but treats orientation 5 as 7. Inline, because the image module uses it too (lib/images).
inline std::vector<char> turned_pixels(const void* stored, int width, int height, std::size_t bytes, int orientation) {
    const bool quarter = is_quarter_turn(orientation);
    const int out_width = quarter ? height : width, out_height = quarter ? width : height;
    // Directions of the stored columns and rows in the upright image.
    const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    const bool from_bottom = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    std::vector<char> out(std::size_t(width) * height * bytes);
    for (int y = 0; y < out_height; ++y) {
        for (int x = 0; x < out_width; ++x) {
            const int column = quarter ? y : x, row = quarter ? x : y;
            const std::size_t from =
                std::size_t(from_bottom ? height - 1 - row : row) * width + (from_right ? width - 1 - column : column);
            std::memcpy(&out[(std::size_t(y) * out_width + x) * bytes], static_cast<const char*>(stored) + from * bytes,
                        bytes);
        }
    }
    return out;
}

/// Turns and mirrors the pixels according to the EXIF orientation 1..8.
Image upright(Image image, int orientation);

/// Writes a copy whose pixels are upright, in the same format, with orientation 1 and all other metadata. JPEG is
/// encoded again at quality 98 without chroma subsampling. Throws DataError.
void write_upright_copy(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace gs
