// SPDX-License-Identifier: Apache-2.0
// Writes and reads .ngsplat files.
#include "lib/export/ngsplat.h"

#include <fmt/format.h>
#include <zlib.h>

#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/export/file_rows.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little, "values are written as they lie in memory");
static_assert(sizeof(PackedCamera) == 18 * 4 && sizeof(GeometryWords) == 16);

constexpr char kMagic[8] = {'N', 'G', 'S', 'P', 'L', 'A', 'T', '\n'};
constexpr char kTrailerMagic[8] = {'G', 'S', 'A', 'P', 'P', 'E', 'X', 'T'};
constexpr std::uint32_t kTrailerVersion = 1;
constexpr std::uint32_t kTextureWidth = 2048;
/// The largest plausible number of cameras, and of bytes of the JSON trailer.
constexpr std::uint32_t kMaxCameras = 1 << 20, kMaxTrailer = 1 << 26;

namespace flag {
constexpr std::uint32_t kAntialiased = 1 << 0, kWithoutConstant = 1 << 1, kFolded = 1 << 2, kExponentialBase = 1 << 5,
                        kPpisp = 1 << 7, kMixed = 1 << 8, kInterleaved = 1 << 9;
constexpr std::uint32_t kKnown = 0x3ff;
// Returns the bits of the model's number: two bits, and a third bit that was added later.
constexpr std::uint32_t model_bits(std::uint32_t model) { return (model & 3) << 3 | (model & 4) << 4; }
constexpr std::uint32_t model_of(std::uint32_t flags) { return (flags >> 3 & 3) | (flags >> 4 & 4); }
}  // namespace flag

struct Header {
    std::uint32_t count, texture_width, texture_height, features, frequencies, bands, color_activation,
        residual_activation, neurons, hidden_layers, flags;
};
static_assert(sizeof(Header) == 44);

std::int64_t padded_count(std::int64_t count) { return (count + kTextureWidth - 1) / kTextureWidth * kTextureWidth; }

class Writer {
  public:
    explicit Writer(std::ostream& out) : out_(out) {}
    template <class T> void value(const T& x) { bytes(&x, sizeof x); }
    template <class T> void values(const std::vector<T>& x) { bytes(x.data(), x.size() * sizeof(T)); }
    void bytes(const void* data, std::size_t size) {
        if (size == 0) return;  // an empty vector's pointer may be null, and null resets zlib's checksum
        crc_ = crc32_z(crc_, static_cast<const Bytef*>(data), size);
        out_.write(static_cast<const char*>(data), std::streamsize(size));
    }
    /// Writes `values_per_gaussian` values per Gaussian, then zeros up to whole rows of a texture.
    template <class T> void texture(const std::vector<T>& x, std::int64_t values_per_gaussian) {
        values(x);
        const std::int64_t count = std::int64_t(x.size()) / values_per_gaussian;
        values(std::vector<T>(std::size_t((padded_count(count) - count) * values_per_gaussian)));
    }
    std::uint32_t crc() const { return std::uint32_t(crc_); }

  private:
    std::ostream& out_;
    uLong crc_ = crc32_z(0, nullptr, 0);
};

class Reader {
  public:
    explicit Reader(const std::filesystem::path& path) : path_(path) {
        if (const std::string fault = input_fault(path); !fault.empty()) fail(fault);
        std::error_code error;
        left_ = std::int64_t(std::filesystem::file_size(path, error));
        if (error) fail(error.message());
        in_.open(path, std::ios::binary);
        if (!in_) fail(std::strerror(errno));
    }
    [[noreturn]] void fail(const std::string& reason) const {
        throw DataError(fmt::format("cannot read '{}': {}", path_.string(), reason));
    }

    std::int64_t left() const { return left_; }
    void need(std::int64_t size, const char* what) const {
        if (left_ < size) fail(fmt::format("truncated: {} needs {} bytes, {} are left", what, size, left_));
    }
    void bytes(void* data, std::int64_t size, const char* what) {
        need(size, what);
        if (size == 0) return;  // as in Writer::bytes
        if (!in_.read(static_cast<char*>(data), std::streamsize(size))) fail(fmt::format("read error in {}", what));
        crc_ = crc32_z(crc_, static_cast<const Bytef*>(data), std::size_t(size));
        left_ -= size;
    }
    template <class T> T value(const char* what) {
        T x;
        bytes(&x, sizeof x, what);
        return x;
    }
    template <class T> std::vector<T> values(std::int64_t count, const char* what) {
        need(count * std::int64_t(sizeof(T)), what);
        std::vector<T> x(static_cast<std::size_t>(count));
        bytes(x.data(), count * std::int64_t(sizeof(T)), what);
        return x;
    }
    template <class T> std::vector<T> texture(std::int64_t count, std::int64_t values_per_gaussian, const char* what) {
        need(padded_count(count) * values_per_gaussian * std::int64_t(sizeof(T)), what);
        std::vector<T> x = values<T>(count * values_per_gaussian, what);
        values<T>((padded_count(count) - count) * values_per_gaussian, what);
        return x;
    }
    template <class T> T finite(const char* what) {
        const T x = value<T>(what);
        static_assert(sizeof(T) % sizeof(float) == 0);
        float floats[sizeof(T) / sizeof(float)];
        std::memcpy(floats, &x, sizeof x);
        for (const float f : floats)
            if (!std::isfinite(f)) fail(fmt::format("{} holds {}", what, f));
        return x;
    }
    std::uint32_t crc() const { return std::uint32_t(crc_); }

  private:
    std::filesystem::path path_;
    std::ifstream in_;
    std::int64_t left_ = 0;
    uLong crc_ = crc32_z(0, nullptr, 0);
};

std::uint32_t flags_of(const PackedScene& scene) {
    const PackedHeader& a = scene.appearance.header;
    return (scene.antialiased ? flag::kAntialiased : 0) | (a.constant_input ? 0 : flag::kWithoutConstant) |
           (a.folded ? flag::kFolded : 0) | flag::model_bits(a.model) |
           (scene.exponential_base ? flag::kExponentialBase : 0) | (scene.ppisp ? flag::kPpisp : 0) |
           (scene.is_mixed() ? flag::kMixed | flag::kInterleaved : 0);
}

Header read_header(Reader& in) {
    char magic[sizeof kMagic] = {};
    if (in.left() < std::int64_t(sizeof kMagic))
        in.fail(fmt::format("{} bytes are too few for an .ngsplat file", in.left()));
    in.bytes(magic, sizeof magic, "the magic");
    if (std::memcmp(magic, kMagic, sizeof kMagic) != 0)
        in.fail("it does not begin with 'NGSPLAT'; it is not an .ngsplat file");
    const Header h = in.value<Header>("the header");
    const std::uint32_t rows = std::uint32_t(padded_count(h.count) / kTextureWidth);
    if (h.texture_width != kTextureWidth)
        in.fail(fmt::format("texWidth is {}, expected {}", h.texture_width, kTextureWidth));
    if (h.texture_height != rows)
        in.fail(fmt::format("texHeight is {}, expected {} for {} Gaussians", h.texture_height, rows, h.count));
    if (h.color_activation > std::uint32_t(PackedColorActivation::kNone))
        in.fail(fmt::format("colorActivation is {}, expected 0 to 5", h.color_activation));
    if (h.residual_activation > std::uint32_t(PackedResidualActivation::kSoftplus))
        in.fail(fmt::format("residualActivation is {}, expected 0 to 2", h.residual_activation));
    if (h.flags & ~flag::kKnown)
        in.fail(fmt::format("flags are {:#x}, but this program knows only {:#x}; the file is of a newer version",
                            h.flags, flag::kKnown));
    return h;
}

PackedHeader appearance_header(const Header& h) {
    PackedHeader a;
    a.model = flag::model_of(h.flags);
    a.features = h.features, a.frequencies = h.frequencies, a.bands = h.bands;
    a.activation = PackedResidualActivation(h.residual_activation);
    a.neurons = h.neurons, a.hidden_layers = h.hidden_layers;
    a.constant_input = !(h.flags & flag::kWithoutConstant);
    a.folded = h.flags & flag::kFolded;
    return a;
}

PackedPpisp read_ppisp(Reader& in, std::size_t num_cameras) {
    PackedPpisp p;
    p.response = in.finite<std::array<float, 18>>("the response curve");
    p.standard = in.finite<PackedFrame>("the default correction");
    for (std::size_t i = 0; i < num_cameras; ++i)
        p.views.push_back(in.finite<PackedFrame>("the correction of a test camera"));
    return p;
}

std::string read_trailer(Reader& in) {
    if (in.left() == 0) return {};
    char magic[sizeof kTrailerMagic] = {};
    const std::int64_t behind = in.left();
    if (behind >= std::int64_t(sizeof magic)) in.bytes(magic, sizeof magic, "the trailer");
    if (std::memcmp(magic, kTrailerMagic, sizeof magic) != 0)
        in.fail(fmt::format("{} unknown bytes follow the last texture", behind));
    const auto version = in.value<std::uint32_t>("the trailer");
    if (version != kTrailerVersion)
        in.fail(fmt::format("its trailer has version {}, but this program reads {}", version, kTrailerVersion));
    const auto length = in.value<std::uint32_t>("the trailer");
    if (length > kMaxTrailer) in.fail(fmt::format("its trailer claims {} bytes", length));
    std::string text(length, '\0');
    in.bytes(text.data(), length, "the trailer");
    const std::uint32_t found = in.crc(), stored = in.value<std::uint32_t>("the checksum");
    if (found != stored) in.fail(fmt::format("checksum {:08x}, expected {:08x}: the file is damaged", found, stored));
    if (in.left() > 0) in.fail(fmt::format("{} bytes follow the trailer", in.left()));
    return text;
}

}  // namespace

int PackedScene::bytes_per_gaussian(bool with_residual) const {
    return int(sizeof(GeometryWords)) + (with_residual ? packed_layout(appearance.header).bytes_per_gaussian() : 0);
}

double PackedScene::mean_bytes_per_gaussian() const {
    const double share = is_mixed() ? double(appearance.rows) / double(count()) : 1;
    return bytes_per_gaussian(false) + share * (bytes_per_gaussian() - bytes_per_gaussian(false));
}

std::int64_t ngsplat_unit() { return kTextureWidth; }

std::int64_t ngsplat_bytes(const PackedScene& scene, std::int64_t count, std::int64_t trailer_bytes) {
    const PackedHeader& a = scene.appearance.header;
    std::size_t bytes = sizeof kMagic + sizeof(Header) + sizeof scene.base_range + a.floats.size() * sizeof(float) +
                        sizeof scene.center + sizeof scene.up + sizeof scene.distance + sizeof(std::uint32_t) +
                        scene.cameras.size() * sizeof(PackedCamera) + sizeof(std::uint32_t) +
                        std::size_t(packed_layout(a).weight_halves) * sizeof(std::uint16_t);
    if (scene.ppisp)
        bytes += sizeof scene.ppisp->response + sizeof scene.ppisp->standard +
                 scene.ppisp->views.size() * sizeof(PackedFrame);
    if (trailer_bytes > 0) bytes += sizeof kTrailerMagic + 3 * sizeof(std::uint32_t) + std::size_t(trailer_bytes);
    const std::int64_t residual = scene.bytes_per_gaussian() - scene.bytes_per_gaussian(false);
    std::int64_t rows = count;
    if (scene.is_mixed()) {
        bytes += sizeof(std::uint32_t);
        rows = std::int64_t(std::ceil(double(count) * double(scene.appearance.rows) / double(scene.count())));
    }
    return std::int64_t(bytes) + padded_count(count) * scene.bytes_per_gaussian(false) + padded_count(rows) * residual;
}

void write_ngsplat(const std::filesystem::path& path, const PackedScene& scene) {
    const PackedHeader& a = scene.appearance.header;
    const PackedLayout layout = packed_layout(a);
    AtomicFile file(path);
    Writer out(file.stream());
    out.bytes(kMagic, sizeof kMagic);
    out.value(Header{std::uint32_t(scene.count()), kTextureWidth,
                     std::uint32_t(padded_count(scene.count()) / kTextureWidth), a.features, a.frequencies, a.bands,
                     std::uint32_t(scene.activation), std::uint32_t(a.activation), a.neurons, a.hidden_layers,
                     flags_of(scene)});
    if (scene.is_mixed()) out.value(std::uint32_t(scene.appearance.rows));
    out.value(scene.base_range);
    out.values(a.floats);
    out.value(scene.center);
    out.value(scene.up);
    out.value(scene.distance);
    out.value(std::uint32_t(scene.cameras.size()));
    out.values(scene.cameras);
    if (scene.ppisp) {
        out.value(scene.ppisp->response);
        out.value(scene.ppisp->standard);
        out.values(scene.ppisp->views);
    }
    out.value(std::uint32_t(layout.weight_halves / 4));
    out.values(scene.appearance.weights);
    if (scene.is_mixed()) {
        std::vector<GeometryWords> geometry;
        for (const std::int64_t row : interleaved_rows(scene.appearance.rows, scene.count()))
            geometry.push_back(scene.geometry[std::size_t(row)]);
        out.texture(geometry, 1);
    } else {
        out.texture(scene.geometry, 1);
    }
    for (std::size_t k = 0; k < layout.texture_words.size(); ++k)
        out.texture(scene.appearance.textures[k], layout.texture_words[k]);
    if (!scene.trailer.empty()) {
        out.bytes(kTrailerMagic, sizeof kTrailerMagic);
        out.value(kTrailerVersion);
        out.value(std::uint32_t(scene.trailer.size()));
        out.bytes(scene.trailer.data(), scene.trailer.size());
        out.value(out.crc());
    }
    file.commit();
}

PackedScene read_ngsplat(const std::filesystem::path& path) {
    Reader in(path);
    const Header h = read_header(in);
    PackedScene scene;
    PackedAppearance& packed = scene.appearance;
    packed.header = appearance_header(h);
    scene.activation = PackedColorActivation(h.color_activation);
    scene.antialiased = h.flags & flag::kAntialiased;
    scene.exponential_base = h.flags & flag::kExponentialBase;
    packed.rows = h.count;
    if (h.flags & flag::kMixed) {
        packed.rows = in.value<std::uint32_t>("nResiduals");
        if (packed.rows >= h.count)
            in.fail(fmt::format("nResiduals is {}, expected less than the {} Gaussians", packed.rows, h.count));
    }
    scene.base_range = in.finite<BaseRange>("the base range");
    PackedLayout layout;
    try {
        layout = packed_layout(packed.header);
    } catch (const DataError& e) {
        in.fail(e.what());
    }
    const PackingDescription& description = packing_description(packed.header.model);
    for (int k = 0; k < description.num_floats; ++k)
        packed.header.floats.push_back(in.finite<float>(description.floats_name.c_str()));
    scene.center = in.finite<std::array<float, 3>>("camCenter");
    scene.up = in.finite<std::array<float, 3>>("camUp");
    scene.distance = in.finite<float>("camDistance");
    const auto num_cameras = in.value<std::uint32_t>("nTestCameras");
    if (num_cameras > kMaxCameras) in.fail(fmt::format("nTestCameras is {}", num_cameras));
    in.need(std::int64_t(num_cameras) * std::int64_t(sizeof(PackedCamera)), "testCameras");
    for (std::uint32_t i = 0; i < num_cameras; ++i) scene.cameras.push_back(in.finite<PackedCamera>("testCameras"));
    if (h.flags & flag::kPpisp) scene.ppisp = read_ppisp(in, num_cameras);
    const auto num_texels = in.value<std::uint32_t>("nWeightTexels");
    if (num_texels != layout.weight_halves / 4)
        in.fail(fmt::format("nWeightTexels is {}, expected {}", num_texels, layout.weight_halves / 4));
    packed.weights = in.values<std::uint16_t>(layout.weight_halves, "the weights");
    if (layout.texture_words.empty()) packed.rows = 0;
    in.need(padded_count(h.count) * std::int64_t(sizeof(GeometryWords)) +
                padded_count(packed.rows) * layout.bytes_per_gaussian(),
            "the textures");
    scene.geometry = in.texture<GeometryWords>(h.count, 1, "splatData");
    if (h.flags & flag::kInterleaved) {
        const std::vector<GeometryWords> in_file = scene.geometry;
        const std::vector<std::int64_t> rows = interleaved_rows(packed.rows, scene.count());
        for (std::size_t i = 0; i < rows.size(); ++i) scene.geometry[std::size_t(rows[i])] = in_file[i];
    }
    for (const int words : layout.texture_words)
        packed.textures.push_back(in.texture<std::uint32_t>(packed.rows, words, "paramTex"));
    scene.trailer = read_trailer(in);
    return scene;
}

}  // namespace gs
