// SPDX-License-Identifier: Apache-2.0
// Readers of images, which decode by OpenImageIO.
#include "lib/io/image.h"
#include "lib/scene/exif.h"
#include "lib/scene/masks.h"
#include "tests/fuzz/target.h"
#include "tests/scene/scene_fixture.h"

namespace gs::fuzz {
namespace {

/// Returns small images of that format: rgb, and where the format has them rgba and grey.
std::vector<std::string> pictures(const std::string& name) {
    std::vector<std::string> seeds;
    for (const int channels : {3, 4}) {
        const bool alpha = channels == 4;
        if (alpha && (name.ends_with("jpg") || name.ends_with("webp") || name.ends_with("bmp"))) continue;
        seeds.push_back(written(name, [&](const std::filesystem::path& path) {
            write_image(path, test::gradient_image(16, 12, channels));
        }));
    }
    return seeds;
}

void read_picture(const std::string& name, const std::string& bytes) {
    const std::filesystem::path path = put(name, bytes);
    read_exif_settings(path);
    read_image_info(path);
    resize_image(read_image(path), 5, 4);
    load_mask({path, true}, true, 7, 6);
}

}  // namespace

std::vector<Target> image_targets() {
    return {
        {"image.png", [] { return pictures("image.png"); }, [](const std::string& b) { read_picture("image.png", b); }},
        {"image.jpg", [] { return pictures("image.jpg"); }, [](const std::string& b) { read_picture("image.jpg", b); }},
        {"image.tif", [] { return pictures("image.tif"); }, [](const std::string& b) { read_picture("image.tif", b); }},
        {"image.exr", [] { return pictures("image.exr"); }, [](const std::string& b) { read_picture("image.exr", b); }},
        {"image.webp", [] { return pictures("image.webp"); },
         [](const std::string& b) { read_picture("image.webp", b); }},
        {"image.bmp", [] { return pictures("image.bmp"); }, [](const std::string& b) { read_picture("image.bmp", b); }},
    };
}

}  // namespace gs::fuzz
