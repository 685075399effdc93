// SPDX-License-Identifier: Apache-2.0
// Reads the headers of image formats just far enough to determine the cost of decoding.
#include "lib/io/image_claim.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <optional>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

// Limits of an image's size, so that a damaged header cannot request all memory. 2^29 pixels is three times the largest
// photographs in use. 65535 is the largest side that JPEG can hold.
constexpr std::int64_t kMaxSide = 65535, kMaxPixels = std::int64_t(1) << 29;

// Some formats (WebP, TIFF with CCITT or Zstandard, JPEG with arithmetic coding) have no useful bound: a few bytes may
// legally encode any number of equal pixels. A small file may therefore use at most this much memory for its decoded
// image and the decoder's work. 512 MiB hold 178 million pixels with three channels of 8 bits, and 76 million pixels of
// a WebP, whose decoder needs four more bytes per pixel. Photographs of that size are larger files. The whole program
// then stays below 1 GiB.
constexpr double kSmallFile = 1 << 20, kSmallFileMemory = 512.0 * (1 << 20);
// The limits are lower for inputs of less than 100 KB, because undistorting and resizing need several times the memory
// of the decoded image. 192 MiB hold 67 million pixels with three channels of 8 bits.
constexpr double kTinyFile = 100 << 10, kTinyFileMemory = 192.0 * (1 << 20);

/// The largest compression ratio of deflate: a match of 258 bytes in two bits.
constexpr double kDeflateRatio = 1032;

/// Huffman-coded JPEG spends at least one bit on each 8x8 block of each component. The blocks are fewest where one
/// component is subsampled four times along x and another along y: 8 blocks for 32x32 pixels. Lossy WebP spends at
/// least three bits on the prediction modes of 16x16 pixels, which is more per pixel.
constexpr double kLossyPixelsPerByte = 1024;

[[noreturn]] void refuse(const fs::path& path, const std::string& reason) {
    throw DataError(fmt::format("image {}: {}", path.string(), reason));
}

std::uint64_t big_endian(const char* p, int bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) value = value << 8 | static_cast<unsigned char>(p[i]);
    return value;
}

std::uint64_t little_endian(const char* p, int bytes) {
    std::uint64_t value = 0;
    for (int i = bytes - 1; i >= 0; --i) value = value << 8 | static_cast<unsigned char>(p[i]);
    return value;
}

/// Reads the first bytes of a file. Reading beyond its end throws.
class Head {
  public:
    explicit Head(const fs::path& path) : path_(path), in_(open_input(path, false)) {}

    /// Returns the `count` bytes at `offset`.
    std::string bytes(std::uint64_t offset, std::size_t count) {
        std::string data(count, '\0');
        in_.seekg(std::streamoff(offset));
        if (!in_.read(data.data(), std::streamsize(count))) {
            require_readable();
            refuse(path_, "cannot be decoded: the file ends within its header, it is truncated");
        }
        return data;
    }
    /// Returns the characters up to the next zero byte. OpenEXR accepts at most kMaxText.
    std::string text(std::uint64_t offset) {
        std::string data;
        in_.seekg(std::streamoff(offset));
        for (char c; in_.get(c) && c != '\0' && data.size() <= kMaxText;) data += c;
        require_readable();
        if (!in_ || data.size() > kMaxText) refuse(path_, "cannot be decoded: a name in its header does not end");
        return data;
    }
    std::uint64_t length() {
        in_.seekg(0, std::ios::end);
        return std::uint64_t(in_.tellg());
    }
    std::string magic() {
        std::string data(16, '\0');
        in_.read(data.data(), 16);
        require_readable();
        data.resize(std::size_t(in_.gcount()));
        in_.clear();
        return data;
    }
    [[noreturn]] void damaged(const std::string& what) const { refuse(path_, "cannot be decoded: " + what); }

  private:
    void require_readable() const {
        if (in_.bad()) refuse(path_, "cannot be read: an error of the disk");
    }

    static constexpr std::size_t kMaxText = 255;

    fs::path path_;
    std::ifstream in_;
};

ImageClaim png_claim(Head& head) {
    ImageClaim claim{"png"};
    const std::string ihdr = head.bytes(8, 21);
    if (ihdr.substr(4, 4) != "IHDR") head.damaged("the PNG does not begin with its header IHDR");
    claim.width = std::int64_t(big_endian(&ihdr[8], 4)), claim.height = std::int64_t(big_endian(&ihdr[12], 4));
    const int depth = ihdr[16], color = ihdr[17];
    const int channels = color == 2 ? 3 : color == 4 ? 2 : color == 6 ? 4 : 1;
    const double pixels = double(claim.width) * double(claim.height);
    claim.least_bytes = pixels * channels * depth / 8 / kDeflateRatio;
    // An interlaced image is decoded as a whole, with its palette expanded, before its first row is available.
    const bool interlaced = ihdr[20] != 0;
    if (interlaced) claim.work_bytes = pixels * (color == 3 ? 4 : channels) * (depth > 8 ? 2 : 1);
    return claim;
}

/// Returns the claim of a JPEG. For files with bytes between their segments, or with thousands of segments, the decoder
/// determines the size.
ImageClaim jpeg_claim(Head& head) {
    ImageClaim claim{"jpeg"};
    constexpr int kMaxSegments = 4096;
    // A segment has FF, a marker, and a two-byte length that includes itself. The frame header (SOF) holds the size.
    std::uint64_t at = 2;
    for (int i = 0; i < kMaxSegments; ++i) {
        const std::string segment = head.bytes(at, 4);
        const unsigned marker = static_cast<unsigned char>(segment[1]);
        const bool bare = marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8);
        const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
        if (segment[0] != '\xff') return claim;
        if (marker == 0xd9 || marker == 0xda) head.damaged("the JPEG has no frame header");
        if (!frame) {
            at += marker == 0xff ? 1 : bare ? 2 : 2 + big_endian(&segment[2], 2);
            continue;
        }
        const std::string sof = head.bytes(at + 5, 5);
        claim.height = std::int64_t(big_endian(&sof[0], 2)), claim.width = std::int64_t(big_endian(&sof[2], 2));
        const double pixels = double(claim.width) * double(claim.height);
        const bool arithmetic = marker > 0xc8, progressive = (marker & 3) == 2;
        if (!arithmetic) claim.least_bytes = pixels / kLossyPixelsPerByte;
        // All coefficients of a progressive image, 16 bits each, are stored before its first row is available.
        if (progressive) claim.work_bytes = 2 * pixels * static_cast<unsigned char>(sof[4]);
        return claim;
    }
    return claim;
}

ImageClaim webp_claim(Head& head) {
    ImageClaim claim{"webp"};
    constexpr std::uint64_t kData = 20;  // offset of the first chunk's data
    const std::string name = head.bytes(12, 4);
    bool animated = false;
    if (name == "VP8X") {
        constexpr char kAnimation = 0x02;  // a flag
        animated = (head.bytes(kData, 1)[0] & kAnimation) != 0;
        const std::string canvas = head.bytes(kData + 4, 6);
        claim.width = 1 + std::int64_t(little_endian(&canvas[0], 3));
        claim.height = 1 + std::int64_t(little_endian(&canvas[3], 3));
    } else if (name == "VP8L") {
        const std::uint64_t bits = little_endian(head.bytes(kData + 1, 4).data(), 4);
        claim.width = 1 + std::int64_t(bits & 0x3fff), claim.height = 1 + std::int64_t(bits >> 14 & 0x3fff);
    } else if (name == "VP8 ") {
        const std::string size = head.bytes(kData + 6, 4);
        claim.width = std::int64_t(little_endian(&size[0], 2) & 0x3fff);
        claim.height = std::int64_t(little_endian(&size[2], 2) & 0x3fff);
        claim.least_bytes = double(claim.width) * double(claim.height) / kLossyPixelsPerByte;
    } else {
        head.damaged("the WebP begins with no image");
    }
    // The frame itself, and for an animation also two canvases, with four bytes per pixel each.
    claim.work_bytes = (animated ? 12.0 : 4.0) * double(claim.width) * double(claim.height);
    return claim;
}

ImageClaim bmp_claim(Head& head) {
    ImageClaim claim{"bmp"};
    const std::uint64_t header_bytes = little_endian(head.bytes(14, 4).data(), 4);
    std::uint64_t bits = 24, compression = 0;
    if (header_bytes == 12) {  // OS/2
        const std::string core = head.bytes(18, 8);
        claim.width = std::int64_t(little_endian(&core[0], 2)), claim.height = std::int64_t(little_endian(&core[2], 2));
        bits = little_endian(&core[6], 2);
    } else {
        const std::string info = head.bytes(18, 16);
        claim.width = std::int32_t(little_endian(&info[0], 4));
        claim.height = std::abs(std::int64_t(std::int32_t(little_endian(&info[4], 4))));  // negative = top row first
        bits = little_endian(&info[10], 2), compression = little_endian(&info[12], 4);
    }
    const double pixels = double(claim.width) * double(claim.height);
    constexpr std::uint64_t kRaw = 0, kMasked = 3;
    if (compression == kRaw || compression == kMasked)
        claim.least_bytes = pixels * double(bits) / 8;
    else
        claim.work_bytes = pixels;  // run lengths, which may omit the rest of an image
    return claim;
}

/// Returns the length of an EXR attribute if its type has a fixed length. OpenEXR reads this many bytes regardless of
/// the stated length.
std::optional<std::uint64_t> fixed_length(const std::string& type) {
    static const std::map<std::string, std::uint64_t> lengths = {{"box2f", 16},
                                                                 {"box2i", 16},
                                                                 {"chromaticities", 32},
                                                                 {"compression", 1},
                                                                 {"deepImageState", 1},
                                                                 {"double", 8},
                                                                 {"envmap", 1},
                                                                 {"float", 4},
                                                                 {"int", 4},
                                                                 {"keycode", 28},
                                                                 {"lineOrder", 1},
                                                                 {"m33d", 72},
                                                                 {"m33f", 36},
                                                                 {"m44d", 128},
                                                                 {"m44f", 64},
                                                                 {"rational", 8},
                                                                 {"tiledesc", 9},
                                                                 {"timecode", 8},
                                                                 {"v2d", 16},
                                                                 {"v2f", 8},
                                                                 {"v2i", 8},
                                                                 {"v3d", 24},
                                                                 {"v3f", 12},
                                                                 {"v3i", 12}};
    const auto found = lengths.find(type);
    return found == lengths.end() ? std::nullopt : std::optional(found->second);
}

/// Returns the end of the EXR attribute in [begin, end) according to its content. It is `end` unless the attribute is
/// damaged.
std::uint64_t content_end(Head& head, const std::string& type, std::uint64_t begin, std::uint64_t end) {
    std::uint64_t at = begin;
    if (type == "chlist") {  // names followed by 16 bytes each, and a final empty name
        for (std::string name; at < end && !(name = head.text(at)).empty();) at += name.size() + 1 + 16;
        return at + 1;
    }
    if (type == "stringvector") {  // texts after their lengths
        while (at < end) at += 4 + little_endian(head.bytes(at, 4).data(), 4);
        return at;
    }
    if (type == "preview") {
        const std::string sides = head.bytes(at, 8);
        return at + 8 + 4 * little_endian(&sides[0], 4) * little_endian(&sides[4], 4);
    }
    return begin + fixed_length(type).value_or(end - begin);
}

/// Checks the lengths of the attributes, for which OpenEXR allocates memory before it reads them. Each attribute has a
/// name, a type, a four-byte length and that many bytes. The decoder determines the image's size.
ImageClaim exr_claim(Head& head) {
    constexpr int kMaxAttributes = 4096;
    const bool several_parts = (little_endian(head.bytes(4, 4).data(), 4) & 0x1000) != 0;
    std::uint64_t at = 8;
    for (int i = 0; i < kMaxAttributes; ++i) {
        const std::string name = head.text(at);
        at += name.size() + 1;
        if (name.empty()) {  // the end of a header; several headers end with one more empty name
            if (!several_parts || head.bytes(at, 1)[0] == '\0') return {"openexr"};
            continue;
        }
        const std::string type = head.text(at);
        at += type.size() + 1;
        const std::uint64_t size = little_endian(head.bytes(at, 4).data(), 4);
        at += 4;
        if (size > head.length() || at > head.length() - size)
            head.damaged(fmt::format("its attribute '{}' claims {} bytes, of which the file lacks some", name, size));
        if (content_end(head, type, at, at + size) != at + size)
            head.damaged(fmt::format("its attribute '{}' of type {} does not have the {} bytes that it claims", name,
                                     type, size));
        at += size;
    }
    head.damaged(fmt::format("its header has more than {} attributes", kMaxAttributes));
}

}  // namespace

ImageClaim read_image_claim(const fs::path& path) {
    if (const std::string fault = input_fault(path); !fault.empty()) refuse(path, fault);
    Head head(path);
    const std::string magic = head.magic();
    const auto begins = [&](std::string_view with) { return magic.starts_with(with); };
    if (magic.empty()) refuse(path, "the file is empty (0 bytes)");
    if (begins("\x89PNG\r\n\x1a\n"sv)) return png_claim(head);
    if (begins("\xff\xd8\xff"sv)) return jpeg_claim(head);
    if (begins("RIFF"sv) && magic.size() >= 12 && magic.compare(8, 4, "WEBP") == 0) return webp_claim(head);
    if (begins("BM"sv)) return bmp_claim(head);
    if (begins("II*\0"sv) || begins("MM\0*"sv) || begins("II+\0"sv) || begins("MM\0+"sv)) return {"tiff"};
    if (begins("\x76\x2f\x31\x01"sv)) return exr_claim(head);
    if (magic.size() >= 12 && magic.compare(4, 4, "ftyp") == 0)
        refuse(path,
               "cannot be decoded: it is a HEIC or AVIF file by its content, whatever its name says; convert it to "
               "JPEG or PNG");
    refuse(path, "cannot be decoded: its first bytes are not those of a PNG, JPEG, TIFF, WebP, BMP or EXR file");
}

void check_image_claim(const fs::path& path, const ImageClaim& claim, double decoded_bytes) {
    const std::string size = fmt::format("{}x{}", claim.width, claim.height);
    if (claim.width <= 0 || claim.height <= 0) refuse(path, fmt::format("the declared size {} is not an image", size));
    if (claim.width > kMaxSide || claim.height > kMaxSide || claim.width * claim.height > kMaxPixels)
        refuse(path, fmt::format("the declared size {} is above the limit of {} pixels; the header is damaged, or the "
                                 "image needs tiling",
                                 size, kMaxPixels));
    std::error_code error;
    const double length = double(fs::file_size(path, error));
    if (error) refuse(path, error.message());
    if (length < claim.least_bytes)
        refuse(path, fmt::format("it declares {} pixels, but its {} bytes cannot hold them ({:.0f} are the least); the "
                                 "file is truncated or damaged",
                                 size, length, std::ceil(claim.least_bytes)));
    const double memory = length < kTinyFile ? kTinyFileMemory : kSmallFileMemory;
    if (length < kSmallFile && decoded_bytes + claim.work_bytes > memory)
        refuse(path, fmt::format("it declares {} pixels, which need {:.0f} MiB of memory; a file of {} bytes gets at "
                                 "most {:.0f}. The header is damaged, or the image needs tiling",
                                 size, (decoded_bytes + claim.work_bytes) / (1 << 20), length, memory / (1 << 20)));
}

}  // namespace gs
