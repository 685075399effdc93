// SPDX-License-Identifier: Apache-2.0
// Sums residuals by cell and photograph, and fits spherical harmonics to each cell.
#include "eval/auto/residual_parts.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "appearance/model_info.h"
#include "appearance/sh_basis.h"
#include "kernels/base/spherical_harmonics.h"
#include "lib/core/median.h"
#include "lib/model/whole_model.h"

namespace gs {
namespace {

/// Side of a voxel, in pixels at the median distance; smaller voxels pick up noise of unresolved detail, larger ones
/// miss small highlights.
constexpr double kVoxelPixels = 16;
constexpr int kDegree = 3, kTerms = (kDegree + 1) * (kDegree + 1);
/// Weight of the penalty on coefficients relative to the data, which limits predictions outside a voxel's directions.
/// From 0.005 to 0.07 the direction share of builtin:diffuse stays below a fourth of that of polished, glossy, moved
/// and lego.
constexpr double kRidge = 0.025;
/// Fewest photographs of a voxel that reveal a dependence on direction.
constexpr int kFewestPhotographs = 4;

using Basis = Eigen::Matrix<double, kTerms, 1>;
using Coefficients = Eigen::Matrix<double, kTerms, 3>;
using Normal = Eigen::Matrix<double, kTerms, kTerms>;

Basis basis(const Eigen::Vector3d& direction) {
    Basis y;
    y[0] = kY0;
    appearance::ShBasis::basis(Vec3<double>{direction.x(), direction.y(), direction.z()}, kDegree, y.data() + 1);
    return y;
}

/// Maps all of space into the ball of radius 2 around the middle of the Gaussians; a camera at the median distance is
/// mapped to radius 1.
struct Contraction {
    Eigen::Vector3d center;
    double radius = 1;

    Contraction(const Gaussians& g, const std::vector<Photograph>& photographs) : center(median_center(g)) {
        std::vector<double> distances;
        for (const Photograph& p : photographs) distances.push_back((p.camera.center() - center).norm());
        radius = std::max(median(std::move(distances)), 1e-9);
    }

    Eigen::Vector3d operator()(const Eigen::Vector3d& point) const {
        const Eigen::Vector3d p = (point - center) / radius;
        const double n = p.norm();
        return n > 1 ? Eigen::Vector3d(p * ((2 - 1 / n) / n)) : p;
    }
};

/// The observations of one voxel in one photograph.
struct Sample {
    double pixels = 0;
    Eigen::Vector3d residual = Eigen::Vector3d::Zero(),
                    direction = Eigen::Vector3d::Zero();  ///< means; the direction has unit length
};
using Samples = std::unordered_map<std::uint64_t, Sample>;

/// A photograph's samples and its squared errors before and after colour alignment, all sums over pixels.
struct Measured {
    Samples samples;
    double error = 0, aligned_error = 0;
};

class Measurement {
  public:
    Measurement(Backend& plain, Backend& positions, const std::vector<Photograph>& photographs,
                const Vec3<float>& background)
        : plain_(plain), positions_(positions), background_(background) {
        Gaussians g = plain.download(false);
        g.ppisp = {};  // would alter encoded positions as it does colours
        g.appearance = plain_sh_appearance(0);
        const Contraction contract(g, photographs);
        for (std::int64_t i = 0; i < g.count; ++i) {
            float* base = g[Group::kBase].param.data() + 3 * i;
            const float* mean = g[Group::kMean].param.data() + 3 * i;
            const Eigen::Vector3d p = contract(Eigen::Vector3f(mean[0], mean[1], mean[2]).cast<double>());
            for (int axis = 0; axis < 3; ++axis)
                base[axis] = float(p[axis] / kSide);  // 1/2 is added on display, giving [0,1]
        }
        positions.upload(g);
        std::vector<double> focal_lengths;
        for (const Photograph& p : photographs) focal_lengths.push_back(p.camera.fx);
        voxel_side_ = kVoxelPixels / median(std::move(focal_lengths)) / kSide;
    }

    Measured operator()(const Photograph& photograph) const {
        RenderedImage render = render_pixels(plain_, photograph, background_);
        const RenderedImage position = render_pixels(positions_, photograph, {0, 0, 0});
        const std::size_t n = photograph.pixels.size();
        Measured out;
        out.error = 3 * double(n) * mean_squared_error(render, photograph);
        align_colours(render, photograph);
        out.aligned_error = 3 * double(n) * mean_squared_error(render, photograph);
        const Camera& camera = photograph.camera;
        for (std::size_t i = 0; i < n; ++i) {
            const double alpha = position.alpha[i];
            if (!(alpha >= 0.5)) continue;
            std::uint64_t key = 0;
            for (std::size_t c = 0; c < 3; ++c)
                key = key << 21 | std::uint64_t(std::clamp(position.rgb[c * n + i] / alpha, 0.0, 1.0) / voxel_side_);
            Sample& sample = out.samples[key];
            sample.pixels += 1;
            for (std::size_t c = 0; c < 3; ++c)
                sample.residual[std::ptrdiff_t(c)] +=
                    photograph.colors.u8[3 * i + c] / 255.0 - std::clamp(double(render.rgb[c * n + i]), 0.0, 1.0);
            const int x = photograph.pixels[i] % camera.width, y = photograph.pixels[i] / camera.width;
            const auto ray = unproject(camera, {x + 0.5, y + 0.5});
            sample.direction += ray.value_or(Eigen::Vector3d(0, 0, 1));
        }
        for (auto& [key, sample] : out.samples) {
            sample.residual /= sample.pixels;
            sample.direction = (camera.rotation.transpose() * sample.direction).normalized();
        }
        return out;
    }

  private:
    static constexpr double kSide = 4;  ///< side of the cube around the ball
    Backend& plain_;
    Backend& positions_;
    const Vec3<float> background_;
    double voxel_side_;  ///< share of the cube's side
};

/// A least-squares fit over the photographs of one voxel, of the mean alone and of all terms. A real scene has a
/// hundred thousand voxels, so `solve` overwrites the inputs with the results.
struct Voxel {
    int photographs = 0;
    double pixels = 0;
    Eigen::Vector3d mean;
    Normal normal = Normal::Zero();                    ///< once solved: its inverse, with the ridge
    Coefficients coefficients = Coefficients::Zero();  ///< until solved: the right-hand side

    void add(const Sample& sample, const Basis& y) {
        ++photographs;
        pixels += sample.pixels;
        normal += sample.pixels * y * y.transpose();
        coefficients += sample.pixels * y * sample.residual.transpose();
    }
    void solve() {
        mean = coefficients.row(0).transpose() / (kY0 * pixels);
        normal.diagonal().tail<kTerms - 1>().array() += kRidge * pixels;
        normal = normal.ldlt().solve(Normal::Identity()).eval();
        coefficients = (normal * coefficients).eval();
    }
    Eigen::Vector3d all(const Basis& y) const { return coefficients.transpose() * y; }
};

/// Returns the squared error that direction removes from a sample: the error of the mean alone minus that of all terms.
double explained_error(const Sample& sample, const Eigen::Vector3d& mean_off, const Eigen::Vector3d& all_off) {
    return sample.pixels * (mean_off.squaredNorm() - all_off.squaredNorm());
}

}  // namespace

ResidualParts residual_parts(Backend& plain, Backend& positions, const std::vector<Photograph>& seen,
                             const std::vector<Photograph>& held_out, const Vec3<float>& background) {
    const Measurement measure(plain, positions, seen, background);
    std::unordered_map<std::uint64_t, Voxel> voxels;
    std::vector<Samples> samples;
    double seen_error = 0;
    for (const Photograph& photograph : seen) {
        Measured measured = measure(photograph);
        seen_error += measured.aligned_error;
        for (const auto& [key, sample] : measured.samples) voxels[key].add(sample, basis(sample.direction));
        samples.push_back(std::move(measured.samples));
    }
    std::erase_if(voxels, [](const auto& entry) { return entry.second.photographs < kFewestPhotographs; });
    for (auto& [key, voxel] : voxels) voxel.solve();

    // Leaving a sample out divides its error by one minus its leverage.
    double seen_explained = 0;
    for (const Samples& of_photograph : samples)
        for (const auto& [key, sample] : of_photograph) {
            const auto found = voxels.find(key);
            if (found == voxels.end()) continue;
            const Voxel& voxel = found->second;
            const Basis y = basis(sample.direction);
            const double mean_leverage = sample.pixels / voxel.pixels,
                         leverage = sample.pixels * y.dot(voxel.normal * y);
            if (mean_leverage > 0.5) continue;  // without it, too little data is left to predict it
            seen_explained += explained_error(sample, (sample.residual - voxel.mean) / (1 - mean_leverage),
                                              (sample.residual - voxel.all(y)) / (1 - leverage));
        }

    double error = 0, aligned_error = 0, held_out_explained = 0;
    for (const Photograph& photograph : held_out) {
        const Measured measured = measure(photograph);
        error += measured.error, aligned_error += measured.aligned_error;
        for (const auto& [key, sample] : measured.samples) {
            const auto found = voxels.find(key);
            if (found == voxels.end()) continue;
            const Voxel& voxel = found->second;
            held_out_explained += explained_error(sample, sample.residual - voxel.mean,
                                                  sample.residual - voxel.all(basis(sample.direction)));
        }
    }
    ResidualParts parts;
    if (seen_error > 0) parts.direction = seen_explained / seen_error;
    if (aligned_error > 0) parts.held_out_direction = held_out_explained / aligned_error;
    if (error > 0) parts.photometric = 1 - aligned_error / error;
    return parts;
}

}  // namespace gs
