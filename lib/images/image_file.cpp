// SPDX-License-Identifier: Apache-2.0
// Opens and decodes image files with OpenImageIO, and defines the only symbol through which the program finds the
// functions of this module.
#include "lib/images/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <new>
#include <type_traits>

#include "kernels/base/error.h"

namespace gs {

std::string reason_from(std::string text) {
    while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
    return text.empty() ? "unknown reason" : text;
}

namespace {

/// Returns the least size in bytes of a TIFF or EXR file with this header. Returns 0 if its compression sets no bound,
/// and for other formats.
double least_bytes(const OIIO::ImageSpec& spec, const std::string& format) {
    if (format != "tiff" && format != "openexr") return 0;
    const std::string compression = spec.get_string_attribute("compression", "none");
    const auto ratio = [&]() -> double {
        if (compression == "none") return 1;
        if (compression == "packbits" || compression == "rle") return 64;  // a run of 128 in two bytes
        if (compression == "zip" || compression == "zips") return 1032;    // deflate: a match of 258 in two bits
        if (compression == "lzw") return 2731;                             // fewer than 4096 bytes in 12 bits
        return 0;
    }();
    if (ratio == 0) return 0;
    const double pixels = double(spec.width) * spec.height;
    if (format == "openexr") return double(spec.image_bytes(true)) / ratio;
    // Files with a palette or subsampled colours store fewer values than channels.
    const int photometric = spec.get_int_attribute("tiff:PhotometricInterpretation", -1);
    const int channels = photometric >= 0 && photometric <= 2 ? spec.nchannels : 1;
    const int bits = spec.get_int_attribute("oiio:BitsPerSample", int(8 * spec.format.size()));
    return pixels * channels * bits / 8 / ratio;
}

/// The largest number of rows that a compression of OpenEXR packs together (DWAB).
constexpr int kExrRows = 256;

/// Returns whether a decoder's message is about lack of memory and not about the file.
bool lacks_memory(const std::string& complaint) {
    const auto says = [&](const char* words) { return complaint.find(words) != std::string::npos; };
    return says("nsufficient memory") || says("ut of memory") || says("bad_alloc");
}

/// Returns whether a decoder that reported success has lost pixels. OpenImageIO returns the rows of truncated TIFF and
/// JPEG files as if they were complete and only stores the decoder's message. Other messages of the JPEG decoder, e.g.
/// about bytes between segments, do not mean lost pixels.
bool is_damage(const std::string& format, const std::string& complaint) {
    if (format == "tiff") return !complaint.empty();
    const auto says = [&](const char* words) { return complaint.find(words) != std::string::npos; };
    return format == "jpeg" && (says("remature end") || says("Huffman code"));
}

}  // namespace

ImageFile::ImageFile(const ImageSource& source) : path_(source.path) {
    ImageClaim claim = source.claim;
    try {
        file_ = std::make_unique<OIIO::Filesystem::IOFile>(path_.string(), OIIO::Filesystem::IOProxy::Read);
        input_ = OIIO::ImageInput::create(claim.format);
        if (!input_) fail(fmt::format("cannot be decoded: OpenImageIO was built without {}", claim.format));
        OIIO::ImageSpec config, header;
        config.attribute("oiio:UnassociatedAlpha", 1);        // alpha stays straight if the format stores it that way
        const bool takes_file = input_->supports("ioproxy");  // all six formats do from OpenImageIO 2.4 on
        if (takes_file) input_->set_ioproxy(file_.get());
        if (!input_->open(takes_file ? "image" : path_.string(), header, config))
            fail_to_decode(reason_from(input_->geterror()));
        input_->geterror();  // clears errors about metadata, which are not damage to pixels
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& e) {
        if (dynamic_cast<const Error*>(&e)) throw;
        fail_to_decode(e.what());
    }
    const OIIO::ImageSpec& spec = input_->spec();
    if (spec.nchannels <= 0)
        fail(fmt::format("size {}x{} with {} channels is not an image", spec.width, spec.height, spec.nchannels));
    if (spec.deep || spec.depth > 1) fail("deep and volume images are not photographs");
    if (claim.width == 0) {
        claim.least_bytes = least_bytes(spec, claim.format);
        // The library and `decode` each hold one jointly decoded part. A TIFF strip may hold the whole image, and so
        // may tiles. An EXR without tiles has at most kExrRows rows per part.
        const bool in_rows = std::strcmp(claim.format, "openexr") == 0 && spec.tile_width == 0;
        const double part = in_rows ? std::min(1.0, double(kExrRows) / std::max(spec.height, 1)) : 1.0;
        claim.work_bytes = 2.0 * part * double(spec.image_bytes(true));
    }
    claim.width = spec.width, claim.height = spec.height;
    const int channels = spec.nchannels == 2 || spec.nchannels > 3 ? 4 : 3, bytes = spec.format.size() > 1 ? 4 : 1;
    source.check(path_, claim, double(spec.width) * spec.height * channels * bytes);
}

template <class T> void ImageFile::decode(const std::function<void(const T*, std::size_t)>& take) {
    constexpr auto kType = std::is_same_v<T, float> ? OIIO::TypeDesc::FLOAT : OIIO::TypeDesc::UINT8;
    const OIIO::ImageSpec& spec = input_->spec();
    const std::size_t row = std::size_t(spec.width) * std::size_t(spec.nchannels);
    const auto check = [&](bool done) {
        const std::string complaint = input_->geterror();
        if (!done || is_damage(input_->format_name(), complaint)) fail_to_decode(reason_from(complaint));
    };
    try {
        if (spec.tile_width > 0) {
            std::vector<T> samples(row * std::size_t(spec.height));
            check(input_->read_image(0, 0, 0, spec.nchannels, kType, samples.data()));
            take(samples.data(), samples.size());
            return;
        }
        // Reads whole TIFF strips, which are decoded together, and at least some four million values at a time.
        const std::size_t strip =
            std::size_t(std::clamp(spec.get_int_attribute("tiff:RowsPerStrip", 1), 1, spec.height));
        const std::size_t wanted = std::max<std::size_t>(1, (std::size_t(1) << 22) / row);
        const int rows = int(std::min((wanted + strip - 1) / strip * strip, std::size_t(spec.height)));
        std::vector<T> samples(row * std::size_t(rows));
        for (int y = 0; y < spec.height; y += rows) {
            const int end = std::min(y + rows, spec.height);
            check(input_->read_scanlines(0, 0, spec.y + y, spec.y + end, 0, 0, spec.nchannels, kType, samples.data()));
            take(samples.data(), row * std::size_t(end - y));
        }
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& e) {
        if (dynamic_cast<const Error*>(&e)) throw;
        fail_to_decode(e.what());
    }
}

template void ImageFile::decode(const std::function<void(const float*, std::size_t)>&);
template void ImageFile::decode(const std::function<void(const std::uint8_t*, std::size_t)>&);

void ImageFile::fail_to_decode(const std::string& complaint) const {
    if (lacks_memory(complaint)) throw std::bad_alloc();
    fail("cannot be decoded: " + complaint);
}

void ImageFile::fail(const std::string& reason) const {
    throw DataError(fmt::format("image {}: {}", path_.string(), reason));
}

}  // namespace gs

extern "C" {
extern const gs::ImageModule gsapp_images;
const gs::ImageModule gsapp_images{gs::images::read_info, gs::images::read, gs::images::encode, gs::images::encode_jpeg,
                                   gs::images::encode_upright};
}
