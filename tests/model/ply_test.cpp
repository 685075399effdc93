// SPDX-License-Identifier: Apache-2.0
// The Gaussian PLY: the layout other programs rely on, round trips, and files that are damaged.
#include "lib/model/ply.h"
#include "kernels/base/spherical_harmonics.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>

#include "kernels/base/error.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

/// The header of a PLY file and the packed floats after it.
struct RawPly {
    std::string header;
    std::vector<float> values;
};
RawPly raw_ply(const std::filesystem::path& path) {
    const std::string bytes = slurp(path);
    const std::size_t end = bytes.find("end_header\n") + 11;
    RawPly raw{bytes.substr(0, end), std::vector<float>((bytes.size() - end) / 4)};
    EXPECT_EQ((bytes.size() - end) % 4, 0u);
    std::memcpy(raw.values.data(), bytes.data() + end, raw.values.size() * 4);
    return raw;
}

/// Returns the property names of a header, separated by blanks.
std::string property_names(const std::string& header) {
    std::istringstream in(header);
    std::string line, names;
    while (std::getline(in, line)) {
        if (!line.starts_with("property ")) continue;
        EXPECT_TRUE(line.starts_with("property float ")) << line;
        names += (names.empty() ? "" : " ") + line.substr(15);
    }
    return names;
}

std::string numbered_names(const std::string& prefix, int n) {
    std::string names;
    for (int k = 0; k < n; ++k) names += " " + prefix + std::to_string(k);
    return names;
}

/// A frame for map coordinates in metres: floats hold them to half a metre.
Frame map_frame() { return {{500000, 4000000, 64}, 0.125}; }

TEST(GaussianPly, MapCoordinatesKeepAnOffsetInTheComments) {
    const TempFolder folder;
    const Gaussians g = random_gaussians(5, {"sh", 1, ColorActivation::kRelu});
    write_ply(folder / "p.ply", g, {.frame = map_frame()});
    const RawPly raw = raw_ply(folder / "p.ply");
    EXPECT_CONTAINS(raw.header, "comment gsapp frame center 500000 4000000 64 scale 0.125\n");
    EXPECT_CONTAINS(raw.header, "comment gsapp offset 500000 4000000 64 (add it to x y z");
    EXPECT_FLOAT_EQ(raw.values[1], g[Group::kMean].param[1] * 8) << "scene units from the offset on";
    EXPECT_FLOAT_EQ(raw.values[6 + 12 + 1], g[Group::kScale].param[0] + std::log(8.0f));
    std::optional<Frame> frame;
    const Gaussians back = read_ply(folder / "p.ply", &frame);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->center, map_frame().center);
    EXPECT_EQ(frame->scale, 0.125);
    EXPECT_EQ(back[Group::kMean].param, g[Group::kMean].param) << "a power of two does not round";
    for (std::size_t i = 0; i < 15; ++i) EXPECT_NEAR(back[Group::kScale].param[i], g[Group::kScale].param[i], 1e-6);
}

TEST(GaussianPly, SaysWhetherTheModelIsAntialiased) {
    const TempFolder folder;
    Gaussians g = random_gaussians(5, {"sh", 1, ColorActivation::kRelu});
    for (const bool antialiased : {false, true}) {
        g.antialiased = antialiased;
        write_ply(folder / "p.ply", g, {});
        EXPECT_CONTAINS(raw_ply(folder / "p.ply").header,
                        std::string("comment SplatRenderMode: ") + (antialiased ? "mip\n" : "default\n"));
        EXPECT_EQ(read_ply(folder / "p.ply").antialiased, antialiased);
    }
}

TEST(GaussianPly, NearOriginsAreWrittenWithoutAnOffset) {
    const TempFolder folder;
    const Gaussians g = random_gaussians(5, {"sh", 1, ColorActivation::kRelu});
    const Frame frame{{1000, 0, -200}, 0.5};
    write_ply(folder / "p.ply", g, {.frame = frame});
    const RawPly raw = raw_ply(folder / "p.ply");
    EXPECT_EQ(raw.header.find("offset"), std::string::npos);
    EXPECT_NEAR(raw.values[0], 2 * g[Group::kMean].param[0] + 1000, 1e-3);
    const Gaussians back = read_ply(folder / "p.ply");
    for (std::size_t i = 0; i < 15; ++i) EXPECT_NEAR(back[Group::kMean].param[i], g[Group::kMean].param[i], 1e-4);
}

TEST(GaussianPly, FilesOfOtherProgramsAndOfUsualScenesHaveNoFrameComment) {
    const TempFolder folder;
    const Gaussians g = random_gaussians(2, {"sh", 0, ColorActivation::kRelu});
    write_ply(folder / "p.ply", g, {});
    std::string bytes = slurp(folder / "p.ply");
    EXPECT_EQ(bytes.find("gsapp frame"), std::string::npos);
    std::optional<Frame> frame;
    read_ply(folder / "p.ply", &frame);
    EXPECT_TRUE(frame && frame->is_identity());
    bytes.replace(bytes.find("comment gsapp appearance"), 24, "comment other appearance");
    spit(folder / "other.ply", bytes);
    read_ply(folder / "other.ply", &frame);
    EXPECT_FALSE(frame);
}

TEST(GaussianPly, CommentsAboutCoordinatesThatMakeNoSenseAreErrors) {
    const TempFolder folder;
    write_ply(folder / "p.ply", random_gaussians(2, {"sh", 0, ColorActivation::kRelu}), {.frame = map_frame()});
    const std::string good = slurp(folder / "p.ply");
    for (const auto& [from, to] : {std::pair{"scale 0.125", "scale 0.000"},
                                   {"scale 0.125", "scale -.125"},
                                   {"frame center 5", "frame center x"},
                                   {"gsapp offset 5", "gsapp offset x"}}) {
        std::string bytes = good;
        bytes.replace(bytes.find(from), std::strlen(from), to);
        spit(folder / "bad.ply", bytes);
        EXPECT_CONTAINS(message_of<DataError>([&] { read_ply(folder / "bad.ply"); }), "cannot understand");
    }
}

TEST(GaussianPly, Degree3MeetsTheFixedLayoutOfSibr) {
    // SIBR reads the rows into this struct without looking at the property names.
    struct RichPoint {
        float position[3], normal[3], sh[48], opacity, scale[3], rotation[4];
    };
    static_assert(sizeof(RichPoint) == 62 * 4);
    const TempFolder folder;
    const Gaussians g = random_gaussians(5, {"sh", 3, ColorActivation::kRelu});
    write_ply(folder / "p.ply", g, {.iteration = 30000});
    const RawPly raw = raw_ply(folder / "p.ply");
    EXPECT_EQ(property_names(raw.header), "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2" + numbered_names("f_rest_", 45) +
                                              " opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3");
    EXPECT_TRUE(raw.header.starts_with("ply\nformat binary_little_endian 1.0\n"));
    EXPECT_CONTAINS(raw.header, "at iteration 30000\n");
    EXPECT_CONTAINS(raw.header, "comment SplatRenderMode: default\n");
    EXPECT_CONTAINS(raw.header, "comment SH degree: 3\n");
    EXPECT_CONTAINS(raw.header, "element vertex 5\n");
    ASSERT_EQ(raw.values.size(), 5u * 62);
    for (int i = 0; i < 5; ++i) {
        RichPoint p;
        std::memcpy(&p, raw.values.data() + 62 * i, sizeof p);
        const float* q = &g[Group::kRotation].param[4 * i];
        const double norm =
            std::sqrt(double(q[0]) * q[0] + double(q[1]) * q[1] + double(q[2]) * q[2] + double(q[3]) * q[3]);
        for (int c = 0; c < 3; ++c) {
            EXPECT_EQ(p.position[c], g[Group::kMean].param[3 * i + c]);
            EXPECT_EQ(p.normal[c], 0);
            EXPECT_EQ(p.scale[c], g[Group::kScale].param[3 * i + c]);
            EXPECT_EQ(p.sh[c], float(g[Group::kBase].param[3 * i + c] / kY0));
            for (int k = 0; k < 15; ++k) EXPECT_EQ(p.sh[3 + 15 * c + k], g[Group::kResidual].param[45 * i + 3 * k + c]);
        }
        EXPECT_EQ(p.opacity, g[Group::kOpacity].param[i]);
        for (int k = 0; k < 4; ++k) EXPECT_EQ(p.rotation[k], float(q[k] / norm));
    }
}

TEST(GaussianPly, OtherActivationsExportTheVisibleBaseColor) {
    const TempFolder folder;
    Gaussians g = random_gaussians(1, {"none", 0, ColorActivation::kSigmoid});
    g[Group::kBase].param = {0.3f, 0, -2};
    write_ply(folder / "p.ply", g, {});
    const RawPly raw = raw_ply(folder / "p.ply");
    EXPECT_EQ(property_names(raw.header),
              "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 app_base_0 "
              "app_base_1 app_base_2");
    EXPECT_CONTAINS(raw.header, "gsapp appearance none max_degree 0 active_degree 0 activation sigmoid");
    // sigmoid(4b) - 1/2, over Y0
    EXPECT_NEAR(raw.values[6], (1 / (1 + std::exp(-1.2)) - 0.5) / kY0, 1e-6);
    EXPECT_EQ(raw.values[7], 0);
    EXPECT_EQ(raw.values[17], 0.3f);
    EXPECT_EQ(raw.values[19], -2);
}

TEST(GaussianPly, OnlyTheFirstGaussiansMayHaveAResidual) {
    const TempFolder folder;
    for (const char* model : {"sh", "nasg", "neural"}) {
        SCOPED_TRACE(model);
        Gaussians g = random_gaussians(6, {model, appearance_model(model).default_max_degree, ColorActivation::kRelu});
        auto& residuals = g[Group::kResidual];
        for (const std::int64_t with : {0, 2, 5}) {
            Gaussians mixed = g;
            mixed[Group::kResidual].param.resize(std::size_t(with * residuals.width));
            write_ply(folder / "p.ply", mixed, {});
            EXPECT_CONTAINS(raw_ply(folder / "p.ply").header, "comment gsapp residuals " + std::to_string(with) + "\n");
            const Gaussians back = read_ply(folder / "p.ply");
            EXPECT_EQ(back.num_residuals(), with);
            EXPECT_EQ(back[Group::kResidual].param, mixed[Group::kResidual].param);
            EXPECT_EQ(back[Group::kOpacity].param, mixed[Group::kOpacity].param);
        }
        write_ply(folder / "p.ply", g, {});
        std::string text = slurp(folder / "p.ply");
        EXPECT_EQ(text.find("residuals"), std::string::npos);
        // A program that moved the rows and kept the comment: nothing is lost.
        text.insert(text.find("element vertex"), "comment gsapp residuals 2\n");
        spit(folder / "p.ply", text);
        EXPECT_EQ(read_ply(folder / "p.ply").num_residuals(), 6);
        std::string longer = text;
        longer.replace(longer.find("residuals 2"), 11, "residuals 7");
        spit(folder / "p.ply", longer);
        EXPECT_EQ(read_ply(folder / "p.ply").num_residuals(), 6) << "rows were removed";
        for (const char* bad : {"-1", "many"}) {
            std::string wrong = text;
            wrong.replace(wrong.find("residuals 2"), 11, std::string("residuals ") + bad);
            spit(folder / "p.ply", wrong);
            EXPECT_CONTAINS(message_of<DataError>([&] { read_ply(folder / "p.ply"); }), "cannot understand");
        }
    }
}

TEST(GaussianPly, SpansSeveralChunks) {
    const TempFolder folder;
    const Gaussians g = random_gaussians(30001, {"sh", 1, ColorActivation::kRelu});
    write_ply(folder / "p.ply", g, {});
    const Gaussians back = read_ply(folder / "p.ply");
    EXPECT_EQ(back[Group::kMean].param, g[Group::kMean].param);
    EXPECT_EQ(back[Group::kResidual].param, g[Group::kResidual].param);
}

TEST(GaussianPly, ZeroRotationIsWrittenAsIdentity) {
    const TempFolder folder;
    Gaussians g = random_gaussians(1, {"none", 0, ColorActivation::kRelu});
    g[Group::kRotation].param = {0, 0, 0, 0};
    write_ply(folder / "p.ply", g, {});
    EXPECT_EQ(read_ply(folder / "p.ply")[Group::kRotation].param, (std::vector<float>{1, 0, 0, 0}));
}

TEST(GaussianPly, RefusesToExportNonFiniteValues) {
    const TempFolder folder;
    Gaussians g = random_gaussians(3, {"none", 0, ColorActivation::kRelu});
    g[Group::kScale].param[3 * 2 + 1] = std::nanf("");
    EXPECT_CONTAINS(message_of<NumericError>([&] { write_ply(folder / "p.ply", g, {}); }), "Gaussian 2 has scale_1");
    EXPECT_EQ(folder.num_entries(), 0u);
}

/// A file of another program: any properties, one row, value = 1, 2, 3, ... in file order.
std::string foreign_ply(const std::string& names, const std::string& type = "float", std::int64_t count = 1,
                        int rows = 1) {
    std::string text = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(count) + "\n", row;
    std::istringstream in(names);
    std::string name;
    for (int k = 1; in >> name; ++k) {
        text += "property " + type + " " + name + "\n";
        const float f = float(k);
        const double d = k;
        row += type == "double" ? std::string(reinterpret_cast<const char*>(&d), 8)
                                : std::string(reinterpret_cast<const char*>(&f), 4);
    }
    text += "end_header\n";
    for (int r = 0; r < rows; ++r) text += row;
    return text;
}

const std::string kMinimal = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

TEST(GaussianPly, ReadsPropertiesByNameInAnyOrderAndDoubles) {
    const TempFolder folder;
    spit(folder / "p.ply",
         foreign_ply("rot_3 rot_2 rot_1 rot_0 extra z y x opacity f_dc_2 f_dc_1 f_dc_0 scale_0 scale_1 scale_2",
                     "double") +
             "tail");
    const Gaussians g = read_ply(folder / "p.ply");
    EXPECT_EQ(g.appearance.model, "none");
    EXPECT_EQ(g[Group::kMean].param, (std::vector<float>{8, 7, 6}));
    EXPECT_EQ(g[Group::kRotation].param, (std::vector<float>{4, 3, 2, 1}));
    EXPECT_EQ(g[Group::kOpacity].param, (std::vector<float>{9}));
    EXPECT_EQ(g[Group::kScale].param, (std::vector<float>{13, 14, 15}));
    EXPECT_NEAR(g[Group::kBase].param[0], 12 * kY0, 1e-6);
}

TEST(GaussianPly, ForeignFileWithBandsIsShOfThatDegree) {
    const TempFolder folder;
    for (const auto& [n, degree] : {std::pair{9, 1}, {24, 2}, {45, 3}}) {
        spit(folder / "p.ply", foreign_ply(kMinimal + numbered_names("f_rest_", n)));
        const Gaussians g = read_ply(folder / "p.ply");
        EXPECT_EQ(describe(g.appearance), describe({"sh", degree, ColorActivation::kRelu}));
        EXPECT_EQ(g.active_degree, degree);
        // Value of f_rest_k is 15 + k; channel-major in the file, coefficient-major in memory.
        EXPECT_EQ(g[Group::kResidual].param[1], 15 + n / 3);
        EXPECT_EQ(g[Group::kResidual].param[3], 16);
    }
}

TEST(GaussianPly, DamagedFilesAreNamedErrors) {
    const TempFolder folder;
    const auto error = [&](const std::string& bytes) {
        spit(folder / "bad.ply", bytes);
        const std::string message = message_of<DataError>([&] { read_ply(folder / "bad.ply"); });
        EXPECT_CONTAINS(message, "bad.ply");
        return message;
    };
    std::istringstream names(kMinimal);
    for (std::string name; names >> name;) {
        std::string without = " " + kMinimal + " ";
        without.replace(without.find(" " + name + " "), name.size() + 2, " ");
        EXPECT_CONTAINS(error(foreign_ply(without)), "'" + name + "' is missing");
    }
    for (const int n : {1, 8, 10, 23, 44, 46}) {
        EXPECT_CONTAINS(error(foreign_ply(kMinimal + numbered_names("f_rest_", n))),
                        std::to_string(n) + " properties f_rest_*");
    }
    EXPECT_CONTAINS(error(foreign_ply(kMinimal + " f_rest_7")), "f_rest_*");
    EXPECT_CONTAINS(error(foreign_ply(kMinimal, "float", 0, 0)), "no Gaussians");
    EXPECT_CONTAINS(error(foreign_ply(kMinimal, "float", 2, 1)), "truncated");
    EXPECT_CONTAINS(error(foreign_ply(kMinimal, "float", std::int64_t(1) << 60, 1)), "truncated");

    Gaussians g = random_gaussians(4, {"sh", 1, ColorActivation::kRelu});
    write_ply(folder / "good.ply", g, {});
    const std::string good = slurp(folder / "good.ply");
    const std::size_t data = good.find("end_header\n") + 11, row = (6 + 3 + 9 + 8) * 4;
    for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
        std::string bytes = good;
        for (std::size_t i = 0; i < 4; ++i) std::memcpy(&bytes[data + i * row + (6 + 3 + 4) * 4], &bad, 4);
        EXPECT_CONTAINS(error(bytes), "none of its 4 Gaussians");
        EXPECT_CONTAINS(error(bytes), "Gaussian 0 has f_rest_4");
    }
    const auto with_comment = [&](const std::string& text) {
        std::string bytes = good;
        const std::size_t begin = bytes.find("gsapp appearance"), end = bytes.find('\n', begin);
        return bytes.replace(begin, end - begin, text);
    };
    EXPECT_CONTAINS(error(with_comment("gsapp appearance velvet max_degree 1 active_degree 1 activation relu")),
                    "velvet");
    EXPECT_CONTAINS(error(with_comment("gsapp appearance sh max_degree 9 active_degree 1 activation relu")),
                    "max_degree 9");
    EXPECT_CONTAINS(error(with_comment("gsapp appearance sh max_degree 2 active_degree 1 activation relu")),
                    "9 properties");
    EXPECT_CONTAINS(error(with_comment("gsapp appearance sh max_degree 1 active_degree 1 activation shiny")), "shiny");
    EXPECT_CONTAINS(error(with_comment("gsapp appearance sh max_degree 1 active_degree 1 activation softplus")),
                    "app_base_0");
    EXPECT_CONTAINS(error(with_comment("gsapp appearance sh nonsense")), "cannot understand");
}

TEST(GaussianPly, InfiniteOpacitiesAndScalesHaveTheMeaningOfTheirLimits) {
    const TempFolder folder;
    Gaussians g = random_gaussians(3, {"sh", 1, ColorActivation::kRelu});
    const float infinity = std::numeric_limits<float>::infinity();
    g[Group::kOpacity].param = {infinity, -infinity, 1};
    g[Group::kScale].param[7] = -infinity;
    for (const Frame& frame : {Frame{}, map_frame()}) {
        write_ply(folder / "p.ply", g, {.frame = frame});
        const Gaussians back = read_ply(folder / "p.ply");
        EXPECT_EQ(back.count, 3);
        EXPECT_EQ(back[Group::kOpacity].param, g[Group::kOpacity].param);
        EXPECT_EQ(back[Group::kScale].param[7], -infinity);
    }
    g[Group::kScale].param[7] = infinity;
    EXPECT_CONTAINS(message_of<NumericError>([&] { write_ply(folder / "q.ply", g, {}); }), "Gaussian 2 has scale_1");
}

TEST(GaussianPly, RowsThatAreNoGaussiansAreLeftOutAndCounted) {
    const TempFolder folder;
    const Gaussians g = random_gaussians(9, {"sh", 1, ColorActivation::kRelu});
    write_ply(folder / "p.ply", g, {});
    std::string bytes = slurp(folder / "p.ply");
    const std::size_t data = bytes.find("end_header\n") + 11, row = (6 + 3 + 9 + 8) * 4;
    const auto put = [&](std::size_t i, std::size_t column, float value) {
        std::memcpy(&bytes[data + i * row + column * 4], &value, 4);
    };
    constexpr std::size_t kOpacity = 18, kScale = 19, kRotation = 22;
    const float nan = std::nanf(""), infinity = std::numeric_limits<float>::infinity();
    put(0, 0, nan), put(2, kOpacity, nan), put(3, kScale, infinity), put(4, kRotation + 1, infinity);
    put(5, 6, -infinity);
    for (std::size_t k = 0; k < 4; ++k) put(7, kRotation + k, 0), put(8, kRotation + k, k == 0 ? -3e9f : 0);
    spit(folder / "p.ply", bytes);
    const Gaussians back = read_ply(folder / "p.ply");
    EXPECT_EQ(back.count, 3);
    EXPECT_EQ(back.num_residuals(), 3);
    const int kept[] = {1, 6, 8};
    for (int i = 0; i < 3; ++i) EXPECT_EQ(back[Group::kMean].param[3 * i], g[Group::kMean].param[3 * kept[i]]);
    EXPECT_EQ(back[Group::kRotation].param[8], -1) << "a rotation may have any length";
}

TEST(GaussianPly, RowsThatAreLeftOutDoNotShiftResiduals) {
    const TempFolder folder;
    Gaussians g = random_gaussians(4, {"sh", 1, ColorActivation::kRelu});
    g[Group::kResidual].param.resize(2 * 9);
    write_ply(folder / "p.ply", g, {});
    std::string bytes = slurp(folder / "p.ply");
    const float nan = std::nanf("");
    std::memcpy(&bytes[bytes.find("end_header\n") + 11], &nan, 4);
    spit(folder / "p.ply", bytes);
    const Gaussians back = read_ply(folder / "p.ply");
    EXPECT_EQ(back.count, 3);
    EXPECT_EQ(back.num_residuals(), 1);
    EXPECT_EQ(back[Group::kResidual].param[4], g[Group::kResidual].param[9 + 4]);
}

TEST(GaussianPly, MutatedFilesNeverCrash) {
    const TempFolder folder;
    write_ply(folder / "good.ply", random_gaussians(3, {"sh", 1, ColorActivation::kSoftplus}), {});
    const std::string good = slurp(folder / "good.ply");
    std::mt19937 random(11);
    int refused = 0;
    for (int i = 0; i < 500; ++i) {
        std::string bytes = good;
        for (int k = 0; k < 1 + i % 4; ++k) bytes[random() % bytes.size()] = char(random());
        if (i % 5 == 0) bytes.resize(random() % bytes.size());
        spit(folder / "m.ply", bytes);
        try {
            const Gaussians g = read_ply(folder / "m.ply");
            EXPECT_EQ(g[Group::kMean].param.size(), std::size_t(g.count) * 3);
        } catch (const DataError&) {
            ++refused;
        }
    }
    EXPECT_GT(refused, 200);
}

}  // namespace
}  // namespace gs::test
