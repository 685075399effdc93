// SPDX-License-Identifier: Apache-2.0
// Loads the image module.
#include "lib/io/image_module.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include "kernels/base/error.h"
#include "lib/core/program_files.h"
#include "lib/io/library_symbol.h"

namespace gs {
namespace {

const ImageModule& load() {
    const std::filesystem::path file = program_library("libgsapp_images.so");
    const void* const module = library_symbol(file.c_str(), "gsapp_images");
    if (!module)
        throw DeviceError(fmt::format("no image can be read or written, because {} cannot be loaded: {}", file.string(),
                                      ::dlerror()));
    return *static_cast<const ImageModule*>(module);
}

}  // namespace

const ImageModule& image_module() {
    static const ImageModule& module = load();
    return module;
}

}  // namespace gs
