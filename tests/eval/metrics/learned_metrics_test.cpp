// SPDX-License-Identifier: Apache-2.0
// LPIPS, DISTS and MILO on seeded random weights, against their definitions in plain loops in double; mistakes in
// weights.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "eval/metrics/learned_metrics.h"
#include "eval/metrics/metrics.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/cuda/cuda_device.h"
#include "lib/train/choose_backend.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/random_weights.h"

namespace gs {
namespace {

using test::noise_image;
using test::random_values;
using test::WeightFile;

constexpr int kVggConvs[13][2] = {{0, 64},   {2, 64},   {5, 128},  {7, 128},  {10, 256}, {12, 256}, {14, 256},
                                  {17, 512}, {19, 512}, {21, 512}, {24, 512}, {26, 512}, {28, 512}};
constexpr int kVggLastOfStage[5] = {2, 7, 14, 21, 28};

/// The weights of all nets, written once.
struct Weights {
    test::TemporaryFolder folder;
    WeightFile vgg, alex, lpips_vgg, lpips_alex, dists, milo;

    Weights() {
        int in = 3;
        for (const auto& [index, out] : kVggConvs) {
            vgg.add_layer("features." + std::to_string(index), out, in, 3, std::uint64_t(index) + 1);
            in = out;
        }
        alex.add_layer("features.0", 64, 3, 11, 100), alex.add_layer("features.3", 192, 64, 5, 102);
        alex.add_layer("features.6", 384, 192, 3, 104), alex.add_layer("features.8", 256, 384, 3, 106);
        alex.add_layer("features.10", 256, 256, 3, 108);
        const int vgg_channels[5] = {64, 128, 256, 512, 512}, alex_channels[5] = {64, 192, 384, 256, 256};
        for (int i = 0; i < 5; ++i) {
            const std::string name = "lin" + std::to_string(i) + ".weight";
            lpips_vgg.tensors[name] = {{1, vgg_channels[i], 1, 1}, random_values(vgg_channels[i], 200 + i, 0, 1)};
            lpips_alex.tensors[name] = {{1, alex_channels[i], 1, 1}, random_values(alex_channels[i], 210 + i, 0, 1)};
        }
        dists.tensors["alpha"] = {{1, 1475, 1, 1}, random_values(1475, 220, 0, 1)};
        dists.tensors["beta"] = {{1, 1475, 1, 1}, random_values(1475, 221, 0, 1)};
        in = 7;
        const int milo_channels[5] = {32, 64, 32, 16, 1};
        for (int i = 0; i < 5; ++i) {
            milo.add_layer("mask_finder_1.netBasic." + std::to_string(2 * i), milo_channels[i], in, 3, 300 + 2 * i);
            in = milo_channels[i];
        }
        vgg.write(path("vgg16.safetensors")), alex.write(path("alexnet.safetensors"));
        lpips_vgg.write(path("lpips_vgg.safetensors")), lpips_alex.write(path("lpips_alex.safetensors"));
        dists.write(path("dists.safetensors")), milo.write(path("milo.safetensors"));
    }
    std::filesystem::path path(const std::string& name) const { return folder.path() / name; }
};

const Weights& weights() {
    static const Weights all;
    return all;
}

/// Values by [channel][row][column].
using Volume = std::vector<std::vector<std::vector<double>>>;

Volume volume(std::size_t channels, int height, int width) {
    return Volume(channels, std::vector(height, std::vector<double>(width)));
}
int height(const Volume& v) { return int(v[0].size()); }
int width(const Volume& v) { return int(v[0][0].size()); }

Volume rgb(const Image& image, const std::function<double(double, int)>& value) {
    Volume v = volume(3, image.height, image.width);
    for (int c = 0; c < 3; ++c) {
        for (int y = 0; y < image.height; ++y) {
            for (int x = 0; x < image.width; ++x)
                v[c][y][x] = value(image.u8[(std::size_t(y) * image.width + x) * 3 + c] / 255.0, c);
        }
    }
    return v;
}

Volume conv(const Volume& in, const WeightFile& file, const std::string& name, int stride, int padding) {
    const auto& [shape, w] = file.tensors.at(name + ".weight");
    const auto& bias = file.tensors.at(name + ".bias").second;
    const int kernel = int(shape[3]);
    Volume out = volume(shape[0], (height(in) + 2 * padding - kernel) / stride + 1,
                        (width(in) + 2 * padding - kernel) / stride + 1);
    for (std::size_t o = 0; o < out.size(); ++o) {
        for (int y = 0; y < height(out); ++y) {
            for (int x = 0; x < width(out); ++x) {
                double sum = bias[o];
                for (std::size_t i = 0; i < in.size(); ++i) {
                    for (int ky = 0; ky < kernel; ++ky) {
                        for (int kx = 0; kx < kernel; ++kx) {
                            const int sy = y * stride + ky - padding, sx = x * stride + kx - padding;
                            if (sy < 0 || sx < 0 || sy >= height(in) || sx >= width(in)) continue;
                            sum += w[((o * in.size() + i) * kernel + ky) * kernel + kx] * in[i][sy][sx];
                        }
                    }
                }
                out[o][y][x] = sum;
            }
        }
    }
    return out;
}

Volume relu(Volume v) {
    for (auto& plane : v) {
        for (auto& row : plane) {
            for (double& value : row) value = std::max(value, 0.0);
        }
    }
    return v;
}

/// Reduces size x size windows that begin every 2 values, `padding` before the first; `reduce` sees the values inside.
Volume pool(const Volume& in, int size, int padding,
            const std::function<double(const std::vector<std::array<double, 3>>&)>& reduce) {
    Volume out = volume(in.size(), (height(in) + 2 * padding - size) / 2 + 1, (width(in) + 2 * padding - size) / 2 + 1);
    for (std::size_t c = 0; c < in.size(); ++c) {
        for (int y = 0; y < height(out); ++y) {
            for (int x = 0; x < width(out); ++x) {
                std::vector<std::array<double, 3>> window;  // value, place in the window
                for (int j = 0; j < size; ++j) {
                    for (int i = 0; i < size; ++i) {
                        const int sy = 2 * y + j - padding, sx = 2 * x + i - padding;
                        if (sy >= 0 && sx >= 0 && sy < height(in) && sx < width(in))
                            window.push_back({in[c][sy][sx], double(j), double(i)});
                    }
                }
                out[c][y][x] = reduce(window);
            }
        }
    }
    return out;
}

Volume largest(const Volume& in, int size) {
    return pool(in, size, 0, [](const auto& window) { return (*std::max_element(window.begin(), window.end()))[0]; });
}

Volume l2(const Volume& in) {
    return pool(in, 3, 1, [](const auto& window) {
        double sum = 1e-12;
        for (const auto& [value, j, i] : window) sum += value * value * (j == 1 ? 0.5 : 0.25) * (i == 1 ? 0.5 : 0.25);
        return std::sqrt(sum);
    });
}

std::vector<Volume> vgg_stages(Volume v, const std::function<Volume(const Volume&)>& pooling) {
    std::vector<Volume> stages;
    for (const auto& [index, out] : kVggConvs) {
        v = relu(conv(v, weights().vgg, "features." + std::to_string(index), 1, 1));
        if (index != kVggLastOfStage[stages.size()]) continue;
        stages.push_back(v);
        if (stages.size() < 5) v = pooling(v);
    }
    return stages;
}

std::vector<Volume> alex_stages(const Volume& v) {
    const WeightFile& w = weights().alex;
    const Volume one = relu(conv(v, w, "features.0", 4, 2)), two = relu(conv(largest(one, 3), w, "features.3", 1, 2));
    const Volume three = relu(conv(largest(two, 3), w, "features.6", 1, 1)),
                 four = relu(conv(three, w, "features.8", 1, 1));
    return {one, two, three, four, relu(conv(four, w, "features.10", 1, 1))};
}

double expected_lpips(const Image& a, const Image& b, LpipsNet net, LpipsRange range) {
    const auto stages = [&](const Image& image) {
        const Volume in = rgb(image, [&](double v, int c) {
            const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
            return ((range == LpipsRange::kSymmetric ? 2 * v - 1 : v) - shift[c]) / scale[c];
        });
        return net == LpipsNet::kVgg ? vgg_stages(in, [](const Volume& v) { return largest(v, 2); }) : alex_stages(in);
    };
    const auto fa = stages(a), fb = stages(b);
    double total = 0;
    for (int s = 0; s < 5; ++s) {
        const auto& head = (net == LpipsNet::kVgg ? weights().lpips_vgg : weights().lpips_alex)
                               .tensors.at("lin" + std::to_string(s) + ".weight")
                               .second;
        double sum = 0;
        for (int y = 0; y < height(fa[s]); ++y) {
            for (int x = 0; x < width(fa[s]); ++x) {
                double na = 0, nb = 0;
                for (std::size_t c = 0; c < head.size(); ++c)
                    na += std::pow(fa[s][c][y][x], 2), nb += std::pow(fb[s][c][y][x], 2);
                for (std::size_t c = 0; c < head.size(); ++c)
                    sum += head[c] *
                           std::pow(fa[s][c][y][x] / (std::sqrt(na) + 1e-10) - fb[s][c][y][x] / (std::sqrt(nb) + 1e-10),
                                    2);
            }
        }
        total += sum / (height(fa[s]) * width(fa[s]));
    }
    return total;
}

double expected_dists(const Image& a, const Image& b) {
    const auto maps = [](const Image& image) {
        const double mean[3] = {0.485, 0.456, 0.406}, deviation[3] = {0.229, 0.224, 0.225};
        std::vector<Volume> all =
            vgg_stages(rgb(image, [&](double v, int c) { return (v - mean[c]) / deviation[c]; }), l2);
        all.insert(all.begin(), rgb(image, [](double v, int) { return v; }));
        return all;
    };
    const auto fa = maps(a), fb = maps(b);
    double similarity = 0, total = 0;
    std::size_t k = 0;
    for (std::size_t s = 0; s < fa.size(); ++s) {
        for (std::size_t c = 0; c < fa[s].size(); ++c, ++k) {
            double n = 0, ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
            for (int y = 0; y < height(fa[s]); ++y) {
                for (int x = 0; x < width(fa[s]); ++x) {
                    const double va = fa[s][c][y][x], vb = fb[s][c][y][x];
                    n += 1, ma += va, mb += vb, aa += va * va, bb += vb * vb, ab += va * vb;
                }
            }
            ma /= n, mb /= n;
            const double l = (2 * ma * mb + 1e-6) / (ma * ma + mb * mb + 1e-6);
            const double s2 = (2 * (ab / n - ma * mb) + 1e-6) / (aa / n - ma * ma + bb / n - mb * mb + 1e-6);
            const double alpha = weights().dists.tensors.at("alpha").second[k],
                         beta = weights().dists.tensors.at("beta").second[k];
            similarity += alpha * l + beta * s2;
            total += alpha + beta;
        }
    }
    return 1 - similarity / total;
}

double expected_milo(const Image& render, const Image& truth) {
    const auto identity = [](double v, int) { return v; };
    std::vector<std::pair<Volume, Volume>> scales = {{rgb(truth, identity), rgb(render, identity)}};
    const auto halved = [](const Volume& v) {
        return pool(v, 2, 0, [](const auto& w) { return (w[0][0] + w[1][0] + w[2][0] + w[3][0]) / 4; });
    };
    for (int i = 0; i < 3; ++i) scales.push_back({halved(scales.back().first), halved(scales.back().second)});
    Volume mask = volume(1, height(scales[3].first) / 2, width(scales[3].first) / 2);
    for (int level = 3; level >= 0; --level) {
        const Volume& t = scales[level].first;
        Volume coarse = volume(1, height(t), width(t));
        for (int y = 0; y < height(t); ++y) {
            for (int x = 0; x < width(t); ++x) {
                const auto place = [](int i, int n) {
                    return n == 1 ? 0.0 : std::min(i, 2 * n - 1) * (n - 1.0) / (2 * n - 1);
                };
                const double py = place(y, height(mask)), px = place(x, width(mask));
                for (int j = 0; j < height(mask); ++j) {
                    for (int i = 0; i < width(mask); ++i)
                        coarse[0][y][x] +=
                            mask[0][j][i] * std::max(0.0, 1 - std::abs(py - j)) * std::max(0.0, 1 - std::abs(px - i));
                }
            }
        }
        Volume v = t;
        v.insert(v.end(), scales[level].second.begin(), scales[level].second.end());
        v.push_back(coarse[0]);
        for (int i = 0; i < 5; ++i) {
            v = conv(v, weights().milo, "mask_finder_1.netBasic." + std::to_string(2 * i), 1, 1);
            if (i < 4) v = relu(v);
        }
        for (int y = 0; y < height(t); ++y) {
            for (int x = 0; x < width(t); ++x) v[0][y][x] = 1 / (1 + std::exp(-v[0][y][x])) + coarse[0][y][x];
        }
        mask = v;
    }
    double sum = 0;
    for (int c = 0; c < 3; ++c) {
        for (int y = 0; y < truth.height; ++y) {
            for (int x = 0; x < truth.width; ++x)
                sum += mask[0][y][x] * std::abs(scales[0].first[c][y][x] - scales[0].second[c][y][x]);
        }
    }
    return sum / (3.0 * truth.width * truth.height);
}

using EnginePointer = std::shared_ptr<const TensorEngine>;

Lpips make_lpips(const EnginePointer& engine, LpipsNet kind, LpipsRange range) {
    const auto net = kind == LpipsNet::kVgg ? load_vgg16(engine, weights().path("vgg16.safetensors"))
                                            : load_alexnet(engine, weights().path("alexnet.safetensors"));
    return {net, kind, weights().folder.path(), range};
}

Dists make_dists(const EnginePointer& engine) {
    return {load_vgg16(engine, weights().path("vgg16.safetensors")), weights().folder.path()};
}

/// Runs a test on every engine there is.
class Definition : public ::testing::TestWithParam<Device> {
  protected:
    void SetUp() override {
        if (GetParam() == Device::kCuda && !cuda_available())
            GTEST_SKIP() << "no CUDA device: " << cuda_unavailable_reason();
        engine_ = choose_tensor_engine(GetParam());
    }
    EnginePointer engine_;
};
INSTANTIATE_TEST_SUITE_P(Engines, Definition, ::testing::Values(Device::kCpu, Device::kCuda),
                         [](const auto& info) { return word(info.param); });

void expect_relative(double value, double expected) {
    EXPECT_LT(std::abs(value - expected) / expected, 1e-5) << value << " " << expected;
}

TEST_P(Definition, OfLpipsWithVgg) {
    const Image a = noise_image(21, 16, 1), b = noise_image(21, 16, 2);
    for (const LpipsRange range : {LpipsRange::kSymmetric, LpipsRange::kUnit}) {
        const Lpips lpips = make_lpips(engine_, LpipsNet::kVgg, range);
        const double score = lpips(a, b);
        expect_relative(score, expected_lpips(a, b, LpipsNet::kVgg, range));
        EXPECT_EQ(lpips(a, a), 0);
        EXPECT_EQ(lpips(b, a), score) << "symmetric";
    }
}

TEST_P(Definition, OfLpipsWithAlexNet) {
    const Image a = noise_image(47, 31, 3), b = noise_image(47, 31, 4);
    for (const LpipsRange range : {LpipsRange::kSymmetric, LpipsRange::kUnit}) {
        const Lpips lpips = make_lpips(engine_, LpipsNet::kAlex, range);
        const double score = lpips(a, b);
        expect_relative(score, expected_lpips(a, b, LpipsNet::kAlex, range));
        EXPECT_EQ(lpips(a, a), 0);
        EXPECT_EQ(lpips(b, a), score) << "symmetric";
    }
}

TEST_P(Definition, OfDists) {
    const Dists dists = make_dists(engine_);
    for (const auto& [width, height] : {std::pair(19, 14), {1, 1}}) {
        const Image a = noise_image(width, height, 5), b = noise_image(width, height, 6);
        const double score = dists(a, b);
        expect_relative(score, expected_dists(a, b));
        EXPECT_EQ(dists(a, a), 0);
        EXPECT_DOUBLE_EQ(dists(b, a), score) << "symmetric, but for which product of a^2 + b^2 the compiler fuses";
    }
}

TEST_P(Definition, OfMilo) {
    const Milo milo(engine_, weights().folder.path());
    for (const auto& [width, height] : {std::pair(16, 16), {23, 17}, {33, 40}}) {
        const Image render = noise_image(width, height, 7), truth = noise_image(width, height, 8);
        expect_relative(milo(render, truth), expected_milo(render, truth));
        EXPECT_NE(milo(render, truth), milo(truth, render)) << "the net sees the truth first";
        EXPECT_EQ(milo(truth, truth), 0);
    }
}

TEST(LearnedMetrics, TheNumberOfThreadsChangesNoBit) {
    const Image a = noise_image(64, 49, 9), b = noise_image(64, 49, 10);
    MetricOptions options;
    options.weights = weights().folder.path(), options.device = Device::kCpu;
    const auto scores = [&] {
        std::vector<std::optional<double>> values;
        for (const Metric& metric : make_metrics({"lpips-alex", "dists", "milo"}, options))
            values.push_back(metric.compute(a, b).value);
        return values;
    };
    const int threads = num_threads();
    set_num_threads(1);
    const auto one = scores();
    set_num_threads(3);
    EXPECT_EQ(scores(), one);
    set_num_threads(threads);
}

TEST(LearnedMetrics, OfOneNetAreThoseOfEachAlone) {
    const Image a = noise_image(20, 17, 13), b = noise_image(20, 17, 14);
    MetricOptions options;
    options.weights = weights().folder.path(), options.device = Device::kCpu;
    const std::vector<Metric> both = make_metrics({"lpips-vgg", "dists"}, options);
    EXPECT_EQ(both[0].compute(a, b).value,
              make_lpips(make_cpu_tensor_engine(), LpipsNet::kVgg, LpipsRange::kSymmetric)(a, b));
    EXPECT_EQ(both[1].compute(a, b).value, make_dists(make_cpu_tensor_engine())(a, b));
}

TEST(LearnedMetrics, SmallImagesAreAReason) {
    MetricOptions options;
    options.weights = weights().folder.path(), options.device = Device::kCpu;
    const std::pair<const char*, int> nets[] = {{"lpips-vgg", 16}, {"lpips-alex", 31}, {"milo", 16}};
    for (const auto& [name, side] : nets) {
        const Metric metric = make_metrics({name}, options)[0];
        const Image small = noise_image(40, side - 1, 11), enough = noise_image(side, side, 12);
        const MetricScore score = metric.compute(small, small);
        EXPECT_FALSE(score.value) << name;
        EXPECT_EQ(score.reason, "not measured: images of 40x" + std::to_string(side - 1) + " pixels, the net needs " +
                                    std::to_string(side) + " in each direction");
        EXPECT_EQ(metric.compute(enough, enough).value, 0.0) << name;
        EXPECT_THROW(metric.compute(small, enough), UsageError);
    }
    EXPECT_THROW(make_lpips(make_cpu_tensor_engine(), LpipsNet::kAlex, LpipsRange::kUnit)(noise_image(30, 30, 1),
                                                                                          noise_image(30, 30, 2)),
                 UsageError);
}

/// Loads the heads in `broken` and returns the message of the DataError.
std::string message(const WeightFile& broken) {
    const test::TemporaryFolder folder;
    weights().alex.write(folder.path() / "alexnet.safetensors");
    broken.write(folder.path() / "lpips_alex.safetensors");
    MetricOptions options;
    options.weights = folder.path(), options.device = Device::kCpu;
    try {
        make_metrics({"lpips-alex"}, options);
    } catch (const DataError& e) {
        return e.what();
    }
    return "no error";
}

TEST(LearnedMetrics, MistakesInWeightsNameFileAndTensor) {
    const auto expect_words = [](const WeightFile& broken, const std::vector<std::string>& words) {
        const std::string text = message(broken);
        for (const std::string& word : words) EXPECT_NE(text.find(word), std::string::npos) << text;
    };
    WeightFile broken = weights().lpips_alex;
    EXPECT_EQ(message(broken), "no error");
    broken.tensors.erase("lin3.weight");
    expect_words(broken, {"lpips_alex.safetensors", "lin3.weight", "missing"});
    broken = weights().lpips_alex;
    broken.tensors["lin1.weight"] = {{192}, std::vector<float>(192)};
    expect_words(broken, {"lpips_alex.safetensors", "lin1.weight", "(192)", "(1,192,1,1)"});
    broken = weights().lpips_alex;
    broken.tensors["lin4.weight"].second[7] = std::nanf("");
    expect_words(broken, {"lpips_alex.safetensors", "lin4.weight", "nan", "index 7"});
    broken.tensors["lin4.weight"].second[7] = std::numeric_limits<float>::infinity();
    expect_words(broken, {"lin4.weight", "inf"});
}

}  // namespace
}  // namespace gs
