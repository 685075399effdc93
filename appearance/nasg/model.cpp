// SPDX-License-Identifier: Apache-2.0
// What the host knows of NASG and NASGabor: parameters, learning rates, first values.
#include "appearance/model_info.h"

#include <algorithm>
#include <cmath>

#include "appearance/nasg/nasg.h"
#include "appearance/nasg/packing.h"
#include "appearance/nasg/stability.h"

namespace gs::appearance {
namespace {

constexpr const char* kLobeRate = "lobe-lr";
/// The largest cosine of an angle that a lobe starts with.
constexpr double kLargestCosine = 0.98;

/// Shared by the models of the folder.
ModelOption lobe_rate_option() {
    return {.key = kLobeRate,
            .default_value = 0.0025,
            .min = 0,
            .max = 10,
            .is_rate = true,
            .nan_word = "auto",
            .help =
                "first rate of the lobes of nasg and nasgabor; auto: the paper's rule, 0.0025 where cameras are 0.354 "
                "scene units apart, "
                "falling with the square of their distance"};
}

/// Where no rate is given, the rule of the NASG reference: 0.0025 at a camera spacing of 0.3536, falling with its
/// square. It depends on the scene's unit, so the factor stays between 1e-3 and 1e3: a scene in millimetres still
/// trains.
double lobe_rate(const RateContext& context) {
    const double given = context.options.at(kLobeRate);
    if (!std::isnan(given)) return given;
    return 0.0025 * std::clamp(std::pow(0.3536 / context.camera_spacing, 2), 1e-3, 1e3);
}

/// Sets the raw angles of a lobe so that its axis is `direction`. Near the ends of the angles (-y and +-x), where they
/// learn badly, the axis is up to 23 degrees beside it.
template <class Model> void aim_lobe(const Vec3<double>& direction, float* raw) {
    const Vec3<double> axis = Model::to_lobe(direction);
    double theta = std::atan2(axis.y, axis.x);
    if (theta < -M_PI / 2) theta += 2 * M_PI;  // LobeFrame has theta in (-pi/2, 3 pi/2), twice its angle less pi/2
    const auto raw_angle = [](double cosine) {
        return float(std::atanh(std::clamp(cosine, -kLargestCosine, kLargestCosine)));
    };
    raw[0] = raw_angle(std::cos((theta + M_PI / 2) / 2)), raw[1] = raw_angle(axis.z);
}

template <class Model> ModelInfo lobe_info(const char* name, const char* summary) {
    constexpr int num_lobes = Model::kMaxResidual / Model::kPerLobe;
    ModelInfo m;
    m.name = name;
    m.summary = summary;
    m.options = {lobe_rate_option()};
    const int carrier = Model::kAmplitude == 6 ? num_lobes * 30 : 0;  // tanh and cosine; sine on the way back
    m.operations = num_lobes * 200 + carrier, m.operations_backward = num_lobes * 350 + 2 * carrier;
    m.default_max_degree = m.max_degree_limit = num_lobes;
    m.residual_width = [](int lobes) { return Model::kPerLobe * lobes; };
    m.rates = [](int, const RateContext& context) {
        // Constant to iteration 7000, then half a cosine that would reach 0 at 37 000.
        const auto decaying = [](double rate) { return Schedule::cosine(rate, 7000, 37000, 0, 1); };
        return AppearanceRates{decaying(0.00025), {decaying(lobe_rate(context))}};
    };
    m.init_residual = [](int lobes, float* row) {
        for (int lobe = 0; lobe < lobes; ++lobe, row += Model::kPerLobe) {
            std::fill_n(row, 3, 0.0f);                      // every angle 90 degrees: the axis is +y
            std::fill_n(row + 3, 2, float(std::log(0.5)));  // sharpness and anisotropy 0.5
            if (Model::kAmplitude == 6) row[5] = -1.6f;     // carrier frequency 1.57
            std::fill_n(row + Model::kAmplitude, 3, 0.5f);
        }
    };
    m.aim_residual = [](int lobes, const Vec3<double>& direction, float* row) {
        for (int lobe = 0; lobe < lobes; ++lobe) aim_lobe<Model>(direction, row + lobe * Model::kPerLobe);
    };
    m.clear_residual = [](int lobes, float* row) {
        for (int lobe = 0; lobe < lobes; ++lobe) std::fill_n(row + lobe * Model::kPerLobe + Model::kAmplitude, 3, 0.0f);
    };
    m.stability = lobe_stability<Model>;
    m.residual = &model_residual<Model, double>;
    m.packing = &lobe_packing<Model>();
    return m;
}

}  // namespace

const ModelInfo& nasg_info() {
    static const ModelInfo info = lobe_info<Nasg>("nasg", "one normalized anisotropic spherical Gaussian");
    return info;
}
const ModelInfo& nasgabor_info() {
    static const ModelInfo info =
        lobe_info<Nasgabor>("nasgabor", "one normalized anisotropic spherical Gaussian with a cosine carrier");
    return info;
}

}  // namespace gs::appearance
