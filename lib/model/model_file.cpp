// SPDX-License-Identifier: Apache-2.0
// Recognises files by their first bytes and by the names inside them.
#include "lib/model/model_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <set>
#include <sstream>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

/// The number of bytes examined at either end of a file, enough for the header of every usual .ply and for the names in
/// a zip archive.
constexpr std::size_t kLookedAt = 1 << 16;

constexpr const char* kExport = "export a .ply from the program that trained it";
constexpr const char* kPyTorch =
    "3DGS writes point_cloud/iteration_N/point_cloud.ply beside it, gsplat's simple_trainer.py does so with "
    "--save_ply, "
    "and nerfstudio by ns-export gaussian-splat";
constexpr const char* kPoints =
    "gsapp train -s SCENE begins with the points of its scene (sparse/0/points3D.ply, or the ply_file_path of a "
    "transforms.json)";

constexpr const char* kSogFolder = "meta.json";

/// The examined parts of a file.
struct Content {
    std::string head, tail;
    std::uint64_t size = 0;

    bool begins(std::string_view text) const { return head.starts_with(text); }
    bool holds(std::string_view text) const {
        return head.find(text) != std::string::npos || tail.find(text) != std::string::npos;
    }
    template <class T> T at(std::size_t offset) const {
        T value;
        std::memcpy(&value, head.data() + offset, sizeof value);
        return value;
    }
};

Content content_of(const fs::path& path) {
    Content content;
    std::ifstream in(path, std::ios::binary);
    const auto read = [&](std::string& part) {
        part.resize(kLookedAt);
        in.read(part.data(), std::streamsize(part.size()));
        part.resize(std::size_t(std::max<std::streamsize>(in.gcount(), 0)));
        in.clear();
    };
    read(content.head);
    in.seekg(0, std::ios::end);
    content.size = std::uint64_t(std::max<std::streamoff>(in.tellg(), 0));
    if (content.size <= kLookedAt) return content;
    in.seekg(std::streamoff(content.size - kLookedAt));
    read(content.tail);
    return content;
}

std::string lower(std::string text) {
    for (char& c : text) c = char(std::tolower(static_cast<unsigned char>(c)));
    return text;
}

std::string quoted(const fs::path& path) {
    const std::string name = path.string();
    const bool plain = std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return std::isalnum(c) || c >= 0x80 || std::strchr("/._-+=:,@", c);
    });
    return plain ? name : "'" + name + "'";
}

/// Returns the message that splat-transform converts the file to .ply. That program determines formats by file
/// extension.
std::string converted(const fs::path& path, const std::string& what, const std::string& ending) {
    fs::path input = path;
    if (ending == kSogFolder)
        input.replace_filename(ending);
    else if (!lower(path.filename().string()).ends_with(ending))
        input.replace_extension(ending);
    fs::path output = ending == kSogFolder ? path.parent_path() / "scene" : fs::path(input).replace_extension();
    if (output.extension() == ".compressed") output.replace_extension();
    output += ".ply";
    if (output == path && input == path) output.replace_extension().concat("-out.ply");
    return fmt::format(
        "it is {}, which gsapp does not read; {}this command makes a file that it reads: npx "
        "@playcanvas/splat-transform {} {}",
        what, input == path ? "" : fmt::format("name it {}, and ", quoted(input.filename())), quoted(input),
        quoted(output));
}

std::string other(const std::string& what, const std::string& advice) { return "it is " + what + "; " + advice; }

/// Examines the header of a .ply.
std::string other_ply(const fs::path& path, const Content& content) {
    const std::size_t end = content.head.find("end_header");
    if (end == std::string::npos) return {};  // the reader reports the missing header end
    std::istringstream header(content.head.substr(0, end));
    std::set<std::string> properties;
    bool has_faces = false;
    for (std::string line; std::getline(header, line);) {
        std::istringstream words(line);
        std::string first, second, last;
        words >> first >> second;
        if (first == "element" && second == "face") has_faces = true;
        if (first != "property") continue;
        for (std::string word; words >> word;) last = word;
        properties.insert(last);
    }
    const auto has = [&](const char* name) { return properties.contains(name); };
    if (has("packed_position")) return converted(path, "a compressed .ply", ".ply");
    const bool has_gaussians = has("f_dc_0") || has("opacity") || has("scale_0") || has("rot_0");
    if (has_gaussians || !has("x") || !has("y") || !has("z")) return {};
    return other(has_faces
                     ? "a mesh, not a model of Gaussians: its vertices have no f_dc_0, opacity, scale_0 or rot_0"
                     : "a point cloud, not a model of Gaussians: its vertices have no f_dc_0, opacity, scale_0 or "
                       "rot_0",
                 kPoints);
}

/// Distinguishes zip archives by their content.
std::string other_zip(const fs::path& path, const Content& content) {
    if (content.holds("data.pkl")) return other("a checkpoint of PyTorch", kPyTorch);
    if (content.holds(".npy")) return other("an archive of NumPy arrays (.npz)", kExport);
    if (content.holds("meta.json") && content.holds(".webp")) return converted(path, "an .sog file", ".sog");
    if (content.holds(".usd")) return other("a scene of USD (.usdz)", kExport);
    return other("a zip archive", "unpack it and name the .ply in it");
}

/// Distinguishes JSON texts by their keys.
std::string other_json(const fs::path& path, const Content& content) {
    const auto has = [&](const char* key) { return content.holds(fmt::format("\"{}\"", key)); };
    if (has("means") && (has("quats") || has("scales")))
        return converted(path, "the description of an unpacked .sog file", kSogFolder);
    if (has("asset") && (has("scenes") || has("meshes") || has("nodes") || has("buffers")))
        return other("a scene of glTF", kExport);
    if (has("totalSplats")) return converted(path, "an .lcc file", ".lcc");
    if (has("frames")) return other("a scene (transforms.json)", "--source SCENE takes its folder");
    if (has("position") && has("rotation"))
        return other("a list of cameras", "a model is the run folder, or the point_cloud.ply in it");
    return other("a text of JSON", "a model is a run folder or a .ply file");
}

/// Returns whether the header is that of a .ksplat: version 0.1 and possible counts.
bool is_ksplat(const Content& content) {
    constexpr std::size_t kHeader = 4096, kSectionHeader = 1024;
    if (content.head.size() < kHeader || content.head[0] != 0 || content.head[1] != 1) return false;
    const auto word = [&](std::size_t k) { return content.at<std::uint32_t>(4 * k); };
    const std::uint64_t sections = word(1);
    return sections >= 1 && word(2) <= sections && word(4) >= 1 && word(4) <= word(3) &&
           content.at<std::uint16_t>(20) <= 2 && content.size >= kHeader + kSectionHeader * sections;
}

/// Returns whether the first records are those of a .splat, which has no header: plausible positions, scales of 0 or
/// more, and unit quaternions.
bool is_splat(const Content& content) {
    constexpr std::size_t kRecord = 32;
    if (content.size == 0 || content.size % kRecord != 0) return false;
    for (std::size_t at = 0; at + kRecord <= std::min<std::size_t>(content.head.size(), 64 * kRecord); at += kRecord) {
        double squares = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            const float place = content.at<float>(at + 4 * k), size = content.at<float>(at + 12 + 4 * k);
            if (!(std::abs(place) < 1e9f) || !(size >= 0 && size < 1e9f)) return false;
        }
        for (std::size_t k = 28; k < 32; ++k) {
            const double q = (content.at<std::uint8_t>(at + k) - 128) / 128.0;
            squares += q * q;
        }
        if (!(squares > 0.9 && squares < 1.1)) return false;
    }
    return true;
}

/// Returns whether the content is a text whose first word, after comments, is a keyword of .obj files.
bool is_obj(const Content& content) {
    std::istringstream lines(content.head.substr(0, 4096));
    for (std::string line; std::getline(lines, line);) {
        std::istringstream words(line);
        std::string word;
        if (!(words >> word) || word[0] == '#') continue;
        return std::set<std::string>{"v", "vn", "vt", "f", "o", "g", "mtllib", "usemtl"}.contains(word);
    }
    return false;
}

/// A kind of file that is recognised by its first bytes and has no conversion command.
struct Known {
    std::string_view begins;
    const char* what;
    const char* advice;
};
constexpr std::array<Known, 18> kKnown = {
    {{"NGSPLAT\n"sv, "an .ngsplat file, a packed scene for the web page, of which no model can be made again",
      "name the run or the .ply that was exported; gsapp view shows the folder that the file lies in"},
     {"glTF"sv, "a scene of glTF (.glb)", kExport},
     {"\x93NUMPY"sv, "an array of NumPy (.npy)", kExport},
     {"\x89HDF\r\n"sv, "a file of HDF5", kExport},
     {"LASF"sv, "a point cloud of a laser scan (.las)", kPoints},
     {"# .PCD"sv, "a point cloud (.pcd)", kPoints},
     {"ASTM-E57"sv, "a point cloud of a laser scan (.e57)", kPoints},
     {"PXR-USDC"sv, "a scene of USD", kExport},
     {"#usda"sv, "a scene of USD", kExport},
     {"Kaydara FBX"sv, "a mesh (.fbx)", kExport},
     {"version https://git-lfs"sv, "a pointer of Git LFS, not the file itself", "git lfs pull fetches it"},
     {"\x89PNG"sv, "an image", "a model is a run folder or a .ply file"},
     {"\xff\xd8\xff"sv, "an image", "a model is a run folder or a .ply file"},
     {"\x28\xb5\x2f\xfd"sv, "compressed (zstd)", "unpack it with zstd -d"},
     {"\xfd\x37zXZ"sv, "compressed (xz)", "unpack it with unxz"},
     {"BZh"sv, "compressed (bzip2)", "unpack it with bunzip2"},
     {"7z\xbc\xaf"sv, "an archive (7z)", "unpack it and name the .ply in it"},
     {"Rar!"sv, "an archive (rar)", "unpack it and name the .ply in it"}}};

}  // namespace

std::string other_model(const fs::path& path) {
    std::error_code error;
    if (fs::is_directory(path, error)) {
        const fs::path meta = path / kSogFolder;
        if (!fs::is_regular_file(meta, error) || fs::exists(path / "config.yaml", error)) return {};
        return other_model(meta);
    }
    if (!input_fault(path).empty()) return {};
    const Content content = content_of(path);
    const std::string name = lower(path.filename().string());
    const auto is_named = [&](std::initializer_list<const char*> endings) {
        return std::any_of(endings.begin(), endings.end(), [&](const char* ending) { return name.ends_with(ending); });
    };
    if (content.size == 0) return other("empty (0 bytes)", "perhaps it was not downloaded or copied completely");
    if (content.begins("ply\n") || content.begins("ply\r")) return other_ply(path, content);
    if (content.begins("PK\x03\x04")) return other_zip(path, content);
    if (content.begins("NGSP") && !content.begins("NGSPLAT")) return converted(path, "an .spz file", ".spz");
    if (is_splat(content)) return converted(path, "a .splat file", ".splat");
    if (content.begins("\x1f\x8b"))
        return is_named({".gz", ".tgz"})
                   ? other("compressed (gzip)", "unpack it with gunzip, or tar -xzf for a .tar.gz")
                   : converted(path, "an .spz file", ".spz");
    for (const Known& known : kKnown)
        if (content.begins(known.begins)) return other(known.what, known.advice);
    // Pickles of protocols 2 to 5, the format of PyTorch before its zip archives.
    if (content.head.size() > 1 && content.head[0] == '\x80' && content.head[1] >= 2 && content.head[1] <= 5)
        return other("a checkpoint of PyTorch, or another pickle of Python", kPyTorch);
    if (content.head.size() > 8 && content.head[8] == '{')
        return other("a file of safetensors", "a checkpoint of gsapp is read by its run folder: name that");
    if (is_ksplat(content)) return converted(path, "a .ksplat file", ".ksplat");
    const std::size_t first = content.head.find_first_not_of("\xef\xbb\xbf \t\r\n");
    const std::string text = first == std::string::npos ? "" : lower(content.head.substr(first, 16));
    if (text.starts_with("<!doctype html") || text.starts_with("<html"))
        return other("a web page", "perhaps a download that failed: open it in a browser");
    if (text.starts_with("{") || text.starts_with("[")) return other_json(path, content);
    if (is_obj(content)) return other("a mesh (.obj)", kExport);
    for (const char* ending : {".splat", ".ksplat", ".spz", ".sog", ".lcc", ".pth", ".pt", ".ckpt", ".npz", ".glb"})
        if (is_named({ending}))
            return other(fmt::format("called {}, but its bytes are not those of such a file", ending),
                         "it is damaged, or of another kind");
    return other("no .ply file: it does not begin with 'ply'", "a model is a run folder or a .ply file of Gaussians");
}

void require_model_file(const fs::path& path) {
    if (const std::string what = other_model(path); !what.empty())
        throw DataError(fmt::format("cannot read '{}': {}", path.string(), what));
}

}  // namespace gs
