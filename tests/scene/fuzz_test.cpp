// SPDX-License-Identifier: Apache-2.0
// Damaged datasets: whatever is in the files, loading ends in a scene or in a gs::Error, and allocates no more than
// they justify.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>
#include <random>

#include "kernels/base/error.h"
#include "lib/scene/scene.h"
#include "tests/scene/scene_fixture.h"

namespace {

std::atomic<bool> watching = false;
std::atomic<std::size_t> largest_request = 0;
std::atomic<std::size_t> largest_granted = ~std::size_t(0);

void watch(std::size_t size) {
    if (!watching) return;
    std::size_t seen = largest_request;
    while (size > seen && !largest_request.compare_exchange_weak(seen, size)) {
    }
}

}  // namespace

// The whole test program allocates through these, so that the largest request during a load is known. Not inlined, or
// the compiler sees malloc and delete meet and warns.
[[gnu::noinline]] void* operator new(std::size_t size) {
    watch(size);
    if (size > largest_granted) throw std::bad_alloc();
    if (void* memory = std::malloc(size ? size : 1)) return memory;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

// OpenImageIO 2.4 itself loses the text of each decoding error; without the leak checker nobody calls this.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() { return "leak:ImageInput::geterror\n"; }

namespace gs {
namespace {

using namespace test;

// The files here are below 4 KB, so that everything read from them fits many times into these limits.
constexpr std::size_t kLargestWhileLoading = 1 << 20;
// OpenImageIO decodes in pieces of 64 MiB, however small the image is.
constexpr std::size_t kLargestWhileDecoding = 65 << 20;

std::string mutate(std::string bytes, std::mt19937& random) {
    const auto below = [&](std::size_t n) {
        return n == 0 ? 0 : std::uniform_int_distribution<std::size_t>(0, n - 1)(random);
    };
    const auto overwrite = [&](std::size_t at, const void* data, std::size_t size) {
        if (at + size <= bytes.size()) std::memcpy(bytes.data() + at, data, size);
    };
    for (std::size_t edits = 1 + below(4); edits > 0; --edits) switch (below(7)) {
            case 0:  // one bit
                if (!bytes.empty()) bytes[below(bytes.size())] ^= char(1 << below(8));
                break;
            case 1:  // one byte
                if (!bytes.empty()) bytes[below(bytes.size())] = char(below(256));
                break;
            case 2:
                bytes.resize(below(bytes.size() + 1));
                break;  // truncated
            case 3: {   // a huge count
                const std::uint64_t counts[] = {std::uint64_t(1) << 60, ~std::uint64_t(0), std::uint64_t(1) << 32,
                                                1000000};
                overwrite(below(4) == 0 ? 0 : below(bytes.size() + 1), &counts[below(4)], 8);
                break;
            }
            case 4: {  // an odd number where doubles lie
                const double values[] = {std::nan(""), HUGE_VAL, -HUGE_VAL, 1e300, -1e300, 1e-310, 0.0, -1.0};
                overwrite(below(bytes.size() + 1), &values[below(8)], 8);
                break;
            }
            case 5: {  // text that numbers, names and JSON may stumble over
                const char* pieces[] = {"nan", "-",    "1e400",   "\"",  "{",
                                        "]",   "null", "\n",      " ",   "99999999999999999999",
                                        "-1",  "true", "\\u0000", "\xff"};
                bytes.insert(below(bytes.size() + 1), pieces[below(14)]);
                break;
            }
            default: {  // a piece repeated or removed
                const std::size_t at = below(bytes.size() + 1),
                                  size = below(std::min<std::size_t>(bytes.size() - at, 40) + 1);
                if (below(2))
                    bytes.insert(at, bytes.substr(at, size));
                else
                    bytes.erase(at, size);
            }
        }
    return bytes;
}

/// Loads a scene and decodes one of its views. Returns whether there was a scene.
bool survives(const std::filesystem::path& source, bool& decoded) {
    SceneOptions options;
    options.source = source.string();
    options.eval = true;
    largest_request = 0;
    watching = true;
    bool loaded = false;
    std::string trouble;
    try {
        const Scene scene = load_scene(options);
        loaded = true;
        if (largest_request > kLargestWhileLoading)
            trouble = "loading allocated " + std::to_string(largest_request) + " bytes at once";
        if (scene.train.empty()) trouble = "a scene without training views";
        if (!(scene.extent > 0)) trouble = "extent is not positive";
        scene.train.at(0).load();
        decoded = true;
    } catch (const Error& error) {
        if (std::string(error.what()).empty()) trouble = "an error without a message";
    } catch (const std::exception& error) {
        trouble = std::string("another exception: ") + error.what();
    }
    watching = false;
    if (largest_request > (loaded ? kLargestWhileDecoding : kLargestWhileLoading))
        trouble = "allocated " + std::to_string(largest_request) + " bytes at once";
    EXPECT_TRUE(trouble.empty()) << trouble;
    return loaded;
}

/// Mutates each of the files in turn. Both ends, a scene and an error, must occur, or the mutations prove nothing.
void fuzz(const TempFolder& folder, const std::vector<std::string>& files, int runs_per_file, unsigned seed) {
    std::mt19937 random(seed);
    bool decoded = false;
    ASSERT_TRUE(survives(folder.path(), decoded));
    ASSERT_TRUE(decoded) << "the undamaged scene must load";
    for (const std::string& file : files) {
        const std::string original = slurp(folder / file);
        int loaded = 0;
        for (int run = 0; run < runs_per_file && !::testing::Test::HasFailure(); ++run) {
            const std::string bytes = mutate(original, random);
            spit(folder / file, bytes);
            loaded += survives(folder.path(), decoded);
            if (::testing::Test::HasFailure())
                ADD_FAILURE() << file << ", run " << run << ", seed " << seed << ", " << bytes.size() << " bytes";
        }
        spit(folder / file, original);
        EXPECT_GT(loaded, 0) << file;
        EXPECT_LT(loaded, runs_per_file) << file;
    }
}

void write_fuzz_model(const TempFolder& folder) {
    // A pinhole, a distorted and a fisheye camera, so that damaged parameters reach every kind of lens code.
    write_model(folder / "sparse/0",
                {TestCamera{},
                 {2, 4, 16, 12, {20, 20, 8, 6, -0.1, 0.01, 0.001, 0.001}},
                 {3, 5, 16, 12, {20, 20, 8, 6, 0.01, 0, 0, 0}}},
                {{1, {1, 0, 0, 0, 0, 0, 4}, 1, "a.png", 1},
                 {2, {1, 0, 0.1, 0, 0, 0, 4}, 2, "b.png", 2},
                 {3, {1, 0, 0, 0.1, 0, 1, 4}, 3, "c.png", 0}},
                {{1, 0, 0, 0, 255, 128, 0, 2}, {2, 0.5, 0.2, 0, 0, 0, 255, 1}, {7, -0.5, -0.2, 0.3, 9, 9, 9, 0}});
    for (const char* name : {"a.png", "b.png", "c.png"}) write_png(folder / "images" / name);
}

TEST(Fuzz, ColmapBinary) {
    TempFolder folder;
    write_fuzz_model(folder);
    fuzz(folder, {"sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin"}, 400, 1);
}

TEST(Fuzz, ColmapText) {
    TempFolder folder;
    spit(folder / "sparse/0/cameras.txt",
         "# cameras\n1 PINHOLE 16 12 20 20 8 6\n2 OPENCV 16 12 20 20 8 6 -0.1 0.01 0.001 0.001\n3 OPENCV_FISHEYE 16 12 "
         "20 20 8 6 0.01 0 0 "
         "0\n");
    spit(folder / "sparse/0/images.txt",
         "# images\n1 1 0 0 0 0 0 4 1 a.png\n1 2 -1 3 4 5\n2 1 0 0.1 0 0 0 4 2 b.png\n\n3 1 0 0 0.1 0 1 4 3 c.png\n1 2 "
         "3\n");
    spit(folder / "sparse/0/points3D.txt",
         "# points\n1 0 0 0 255 128 0 0.5 1 0 2 0\n2 0.5 0.2 0 0 0 255 0.1\n7 -0.5 -0.2 0.3 9 9 9 1e-3 1 1\n");
    for (const char* name : {"a.png", "b.png", "c.png"}) write_png(folder / "images" / name);
    fuzz(folder, {"sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt"}, 250, 2);
}

TEST(Fuzz, TransformsJson) {
    TempFolder folder;
    spit(folder / "transforms.json",
         "{\"fl_x\": 20.0, \"fl_y\": 21, \"cx\": 8, \"cy\": 6.5, \"w\": 16, \"h\": 12, \"k1\": -0.1, \"k2\": 0.01, "
         "\"p1\": 0.001, \"p2\": "
         "0, "
         "\"camera_model\": \"OPENCV\",\n \"frames\": [\n"
         "{\"file_path\": \"images/a.png\", \"transform_matrix\": [[1,0,0,0.5],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},\n"
         "{\"file_path\": \"images/b\", \"fl_x\": 19, \"transform_matrix\": [[0,-1,0,0],[1,0,0,1.5],[0,0,1,4]]},\n"
         "{\"file_path\": \"./images/c.png\", \"mask_path\": \"m.png\", \"camera_angle_x\": 0.8, "
         "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}]}\n");
    for (const char* name : {"images/a.png", "images/b.png", "images/c.png", "m.png"}) write_png(folder / name);
    fuzz(folder, {"transforms.json"}, 700, 3);
}

TEST(Fuzz, Images) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});  // a single one, for a scene without images is an error
    fuzz(folder, {"images/a.png"}, 150, 4);
}

TEST(OutOfMemory, IsNoDamageOfAnImage) {
    TempFolder folder;
    write_png(folder / "a.png", 640, 480);
    largest_granted = 640 * 480;
    const std::string message = message_of<DeviceError>([&] { read_image(folder / "a.png"); });
    largest_granted = ~std::size_t(0);
    EXPECT_CONTAINS(message, "a.png: out of memory");
}

}  // namespace
}  // namespace gs
