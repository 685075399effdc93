// SPDX-License-Identifier: Apache-2.0
// Host-side description of NASG and NASGabor: parameters, learning rates, initial values, packing for viewers
// (docs/formats.md#scenengsplat), and degenerate cases for the stability measurement.
#include <algorithm>
#include <cmath>

#include "appearance/model_info.h"
#include "appearance/nasg/nasg.h"
#include "appearance/packing.h"

namespace gs::appearance {
namespace {

/// The largest stored normalization. The excess of a larger one is moved into the amplitude, because only their product
/// matters.
inline constexpr double kLargestPackedNorm = 6e4;

template <class Model> constexpr bool kHasCarrier = Model::kAmplitude == 6;
template <class Model> const PackingDescription& description() {
    return packing_description(kHasCarrier<Model> ? "nasgabor" : "nasg");
}

template <class Model> PackedAppearance prepare(const Gaussians& g) {
    PackedHeader header;
    header.model = description<Model>().id;
    header.features = std::uint32_t(g.active_degree);
    return make_packed(header, g);
}

/// Writes for each lobe: axes x and z (6), 2 lambda, a, with a carrier k, N, amplitude (3).
template <class Model> void pack_row(const Gaussians& g, std::int64_t row, PackedAppearance& packed) {
    using Density = LobeDensity<double>;
    const auto& residual = g[Group::kResidual];
    int k = 0;
    const auto put = [&](double value) { set_half(packed, row, k++, value); };
    const auto put_vector = [&](const Vec3<double>& v) { put(v.x), put(v.y), put(v.z); };
    for (int lobe = 0; lobe < g.active_degree; ++lobe) {
        double raw[Model::kPerLobe];
        std::copy_n(residual.param.data() + row * residual.width + lobe * Model::kPerLobe, Model::kPerLobe, raw);
        const auto frame = Model::template Frame<double>::of(raw);
        const double t = Density::twice_sharpness(raw[3]), a = Density::anisotropy(raw[4]);
        const double norm = Density::norm(t, a), stored = std::min(norm, kLargestPackedNorm);
        put_vector(Model::from_lobe(frame.x));
        put_vector(Model::from_lobe(frame.z));
        put(t);
        put(a);
        if constexpr (kHasCarrier<Model>) put(Carrier<double>::of(raw[5], 0).frequency);
        put(stored);
        put_vector(Model::amplitude(raw) * (norm / stored));
    }
}

Vec3<double> normalized(const Vec3<double>& v) { return v * (1 / std::max(std::sqrt(dot(v, v)), 1e-12)); }

template <class Model>
Vec3<double> residual(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction) {
    Vec3<double> sum{0, 0, 0};
    int k = 0;
    const auto get = [&] { return get_half(packed, row, k++); };
    const auto get_vector = [&] {
        const double x = get(), y = get(), z = get();
        return Vec3<double>{x, y, z};
    };
    for (std::uint32_t lobe = 0; lobe < packed.header.features; ++lobe) {
        // Rounded axes are neither of unit length nor perpendicular; without renormalization, the lobe would have a rim
        // around its axis.
        const Vec3<double> stored_x = get_vector(), z = normalized(get_vector()),
                           x = normalized(stored_x - z * dot(stored_x, z)), y = cross(z, x);
        const Vec3<double> v{dot(x, direction), dot(y, direction), dot(z, direction)};
        const double t = get(), a = get();
        double carrier = 1;
        if constexpr (kHasCarrier<Model>) carrier = std::pow(std::cos(0.5 * get() * v.x), 2);
        const double norm = get();
        sum += get_vector() * (carrier * LobeDensity<double>::of_shape(v, t, a, norm).value);
    }
    return sum;
}

/// Returns the packing of Nasg or Nasgabor.
template <class Model> const Packing& lobe_packing() {
    static const Packing packing{&description<Model>(), prepare<Model>, pack_row<Model>, residual<Model>};
    return packing;
}
template const Packing& lobe_packing<Nasg>();
template const Packing& lobe_packing<Nasgabor>();

/// Raw amplitudes of the cases with known limits: saturated with either sign, and ordinary.
constexpr double kAmplitudes[3] = {20, -20, 0.5};

template <class Model> std::vector<double> lobe(double angle, double raw_sharpness, double raw_anisotropy) {
    std::vector<double> raw = {angle, -angle, angle, raw_sharpness, raw_anisotropy};
    if (Model::kAmplitude == 6) raw.push_back(-1.6);
    raw.insert(raw.end(), std::begin(kAmplitudes), std::end(kAmplitudes));
    return raw;
}

/// Returns the world direction of local (vx, vy, vz) in the frame of zero angles, which is exact in float:
/// x = (0,0,-1), y = (-1,0,0), z = (0,1,0).
std::array<double, 3> unturned(double vx, double vy, double vz) { return {-vy, vz, -vx}; }

/// Returns the density at the axis, N = lambda sqrt(1+a) / (2 pi (1 - e^(-2 lambda))).
double peak(double raw_sharpness, double raw_anisotropy) {
    const double lambda = std::clamp(std::exp(raw_sharpness), 1e-6, 1e4), a = std::min(std::exp(raw_anisotropy), 1e4);
    return lambda * std::sqrt(1 + a) / (2 * M_PI * -std::expm1(-2 * lambda));
}

template <class Model> void add_poles(StabilityPlan& plan) {
    const double shapes[][2] = {
        {std::log(0.5), std::log(0.5)}, {-1e4, -1e4}, {-16, 1}, {std::log(100), 2}, {2, 1e4}, {1e4, -3}, {1e4, 1e4}};
    for (const auto& [sharpness, anisotropy] : shapes)
        for (const double distance : {0., 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 4e-4, 1e-3})
            for (const double azimuth : {0., 0.7, 1.5, 2.5}) {
                const double vx = distance * std::cos(azimuth), vy = distance * std::sin(azimuth);
                StabilityCase axis{"on the axis", lobe<Model>(0, sharpness, anisotropy), unturned(vx, vy, 1), {}, {}};
                StabilityCase antipode{"at the antipode", axis.residual, unturned(vx, vy, -1), {}, {}};
                if (distance == 0) {
                    const double n = peak(sharpness, anisotropy),
                                 bottom = n * std::exp(-2 * std::min(std::exp(sharpness), 1e4));
                    axis.limit = {n, -n, n * std::tanh(kAmplitudes[2])}, axis.limit_name = "N";
                    antipode.limit = {bottom, -bottom, bottom * std::tanh(kAmplitudes[2])},
                    antipode.limit_name = "N exp(-2 lambda)";
                }
                plan.cases.push_back(axis);
                plan.cases.push_back(antipode);
            }
}

template <class Model> void add_frames(StabilityPlan& plan) {
    for (const double angle : {7.0, kLargestRawAngle, 7.2544, 8.0, 1e4, 3.4e38})
        for (int signs = 0; signs < 8; ++signs)
            for (int axis = 0; axis < 3; ++axis)
                for (const double end : {-1., 1.})
                    for (const double off : {0., 1e-4, 0.1}) {
                        std::vector<double> raw = lobe<Model>(angle, 1, 0.5);
                        for (int k = 0; k < 3; ++k) raw[k] = signs & 1 << k ? angle : -angle;
                        std::array<double, 3> view{off, off, off};
                        view[axis] = end;
                        plan.cases.push_back({"frames at their limits", raw, view, {}, {}});
                    }
}

/// Adds cases with `column` at each value and at relative offsets of up to 1e-3 on either side.
template <class Model> void add_around(StabilityPlan& plan, int column, std::initializer_list<double> values) {
    for (const double value : values)
        for (const double side : {-1e-3, -1e-7, 0., 1e-7, 1e-3})
            for (const std::array<double, 3> view : {std::array{0.3, 0.8, -0.4}, {-0.5, -0.2, 0.9}, {0.02, 1., 0.01}}) {
                std::vector<double> raw = lobe<Model>(0.3, -0.4, 0.6);
                raw[column] = value * (1 + side);
                plan.cases.push_back({plan.column_kinds[column], raw, view, {}, {}});
            }
}

/// Returns the cases of one lobe: directions at the axis and its antipode, and at distances of 1e-8 to 1e-3 from them,
/// for lobes from uniform to the narrowest; frames with angles at their limits; values at and around every limit. Model
/// is Nasg or Nasgabor.
template <class Model> StabilityPlan lobe_stability() {
    StabilityPlan plan;
    plan.column_kinds = {"angles", "angles", "angles", "sharpness", "anisotropy"};
    if (Model::kAmplitude == 6) plan.column_kinds.push_back("carrier");
    plan.column_kinds.insert(plan.column_kinds.end(), 3, "amplitude");
    add_poles<Model>(plan);
    add_frames<Model>(plan);
    for (int angle = 0; angle < 3; ++angle) add_around<Model>(plan, angle, {-kLargestRawAngle, kLargestRawAngle});
    add_around<Model>(plan, 3, {kLargestRawShape, kSmallestRawSharpness, -12, -17});
    add_around<Model>(plan, 4, {kLargestRawShape, -15, -17});
    // From 9.01 on tanh is 1 in float, so that a slope computed from it would be 0; from 43 to 50 the slope itself
    // underflows.
    for (int k = 5; k < int(plan.column_kinds.size()); ++k)
        add_around<Model>(plan, k, {-50, -44, -43, -12, -9.01, 9.01, 12, 43, 44, 50});
    return plan;
}

template StabilityPlan lobe_stability<Nasg>();
template StabilityPlan lobe_stability<Nasgabor>();

constexpr const char* kLobeRate = "lobe-lr";
/// The largest |cos| of a lobe's initial angles.
constexpr double kLargestCosine = 0.98;

/// Returns the option for the learning rate of lobes, shared by the models of the folder.
ModelOption lobe_rate_option() {
    return {.key = kLobeRate,
            .default_value = 0.0025,
            .min = 0,
            .max = 10,
            .is_rate = true,
            .unset_word = "auto",
            .help =
                "first rate of the lobes of nasg and nasgabor; auto: the paper's rule, 0.0025 where cameras are 0.354 "
                "scene units apart, "
                "falling with the square of their distance",
            .measured =
                "auto, nasg: builtin:glossy 31.57 instead of 33.21 dB, lego 35.48 instead of 35.37 "
                "([appearance](lab/appearance.md#appearance-models-quality))"};
}

/// Returns the given learning rate, or else the rate of the NASG reference: 0.0025 at a camera spacing of 0.3536,
/// falling with the square of the spacing. The rule depends on the scene's unit, so its factor is clamped to 1e-3..1e3,
/// and a scene in millimetres still trains.
double lobe_rate(const RateContext& context) {
    if (const auto& given = context.options.at(kLobeRate)) return *given;
    return 0.0025 * std::clamp(std::pow(0.3536 / context.camera_spacing, 2), 1e-3, 1e3);
}

/// Sets the raw angles of a lobe so that its axis is `direction`. Near the ends of the angles' ranges (-y and +-x),
/// where training is poor, the axis deviates by up to 23 degrees.
template <class Model> void aim_lobe(const Vec3<double>& direction, float* raw) {
    const Vec3<double> axis = Model::to_lobe(direction);
    double theta = std::atan2(axis.y, axis.x);
    if (theta < -M_PI / 2) theta += 2 * M_PI;  // LobeFrame has theta in (-pi/2, 3 pi/2), twice its LobeAngle minus pi/2
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
    const int carrier = Model::kAmplitude == 6 ? num_lobes * 30 : 0;  // tanh and cosine; also sine in the backward pass
    m.operations = num_lobes * 200 + carrier, m.operations_backward = num_lobes * 350 + 2 * carrier;
    m.default_max_degree = m.max_degree_limit = num_lobes;
    m.residual_width = [](int lobes) { return Model::kPerLobe * lobes; };
    m.rates = [](int, const RateContext& context) {
        // Constant until iteration 7000, then half a cosine that would reach 0 at 37 000.
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
