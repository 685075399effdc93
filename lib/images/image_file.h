// SPDX-License-Identifier: Apache-2.0
// An image file opened by OpenImageIO: by its first bytes and not by its name, and only if it can hold what it
// declares.
#pragma once

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "lib/io/image_module.h"

namespace gs {

/// Returns a message of OpenImageIO without the line break at its end, "unknown reason" for an empty one.
std::string reason_from(std::string text);

class ImageFile {
  public:
    /// Reads the header. Throws DataError naming the file and the reason. As all functions here it throws
    /// std::bad_alloc for want of memory, which is no fault of the file.
    explicit ImageFile(const ImageSource& source);

    const OIIO::ImageSpec& spec() const { return input_->spec(); }

    /// Decodes from top to bottom and hands on some rows at a time: `take(samples, count)` with `count` values of all
    /// channels, of type T. So memory only grows as rows come. T is float or std::uint8_t. Throws DataError.
    template <class T> void decode(const std::function<void(const T*, std::size_t)>& take);

    /// Throws DataError "image FILE: reason".
    [[noreturn]] void fail(const std::string& reason) const;

  private:
    /// Throws std::bad_alloc where the decoder got no memory, else DataError.
    [[noreturn]] void fail_to_decode(const std::string& complaint) const;

    std::filesystem::path path_;
    // A name may hold characters that OpenImageIO would read as a query ("?") or a pattern. It gets the open file.
    std::unique_ptr<OIIO::Filesystem::IOFile> file_;
    std::unique_ptr<OIIO::ImageInput> input_;
};

}  // namespace gs
