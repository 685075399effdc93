// SPDX-License-Identifier: Apache-2.0
// The functions of the image module (lib/io/image_module.h). They open image files with OpenImageIO by their first
// bytes and not by their names, and only if the files can hold the image that they declare.
#pragma once

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "lib/io/image_module.h"

namespace gs::images {

ImageInfo read_info(const ImageSource& source);
Image read(const ImageSource& source);
std::vector<std::uint8_t> encode(const std::filesystem::path& path, const Image& image);
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);
std::vector<std::uint8_t> encode_upright(const std::filesystem::path& from, const std::filesystem::path& to,
                                         int orientation);

}  // namespace gs::images

namespace gs {

/// Returns an OpenImageIO message without its trailing newline, or "unknown reason" if it is empty.
std::string reason_from(std::string text);

/// An image file opened by OpenImageIO: by its first bytes and not by its name, and only if it can hold the image that
/// it declares.
class ImageFile {
  public:
    /// Reads the header. Throws DataError naming the file and the reason. Like all functions here it throws
    /// std::bad_alloc if memory runs out, which is not an error of the file.
    explicit ImageFile(const ImageSource& source);

    const OIIO::ImageSpec& spec() const { return input_->spec(); }

    /// Decodes from top to bottom and passes on some rows at a time: `take(samples, count)` with `count` values of all
    /// channels, of type T. So memory only grows as rows arrive. T is float or std::uint8_t. Throws DataError.
    template <class T> void decode(const std::function<void(const T*, std::size_t)>& take);

    /// Throws DataError "image FILE: reason".
    [[noreturn]] void fail(const std::string& reason) const;

  private:
    /// Throws std::bad_alloc if the decoder ran out of memory, else DataError.
    [[noreturn]] void fail_to_decode(const std::string& complaint) const;

    std::filesystem::path path_;
    // OpenImageIO gets the open file, because it would interpret some characters of a name as a query ("?") or a
    // pattern.
    std::unique_ptr<OIIO::Filesystem::IOFile> file_;
    std::unique_ptr<OIIO::ImageInput> input_;
};

}  // namespace gs
