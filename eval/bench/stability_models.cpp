// SPDX-License-Identifier: Apache-2.0
// Measures residual, colour and all gradients of every registered model while one kind of input at a time is swept.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "eval/bench/stability_compare.h"
#include "kernels/base/parallel.h"
#include "kernels/preprocess/gaussian_device.h"

#include "appearance_types.inc"

namespace gs {
namespace {

using Results = StabilitySubject::Results;

constexpr float kLargest = std::numeric_limits<float>::max();
/// Largest value for all columns of a kind at once. The sum of larger values would exceed float's range.
constexpr float kLargestTogether = 1e30f;
/// Upper end of the usual gradient of a Gaussian's colour if the loss is a mean over an image.
constexpr float kTypicalGradient = 1e-3f;
/// Allowed relative error of an exact limit. NASG's floor under the exponent of K alone costs 2e-4.
constexpr double kLimitTolerance = 3e-4;
constexpr const char* kSharedKind = "shared weights";
/// Minimum number of cases per value, and the number per column.
constexpr int kTrials = 24, kTrialsPerColumn = 2;

/// Indices of a model's inputs among the numbers of a case.
template <class Model> struct Layout {
    static constexpr int kResidual = 0, kShared = Model::kMaxResidual, kBase = kShared + kNumSharedOf<Model>,
                         kView = kBase + 3, kGradient = kView + 3, kCount = kGradient + 3;
};

template <class T> Vec3<T> vec3(const T* p) { return {p[0], p[1], p[2]}; }
template <class T> void append(Results& out, const Vec3<T>& v) { out.insert(out.end(), {v.x, v.y, v.z}); }

/// Returns residual, colour, then the gradients of residual parameters, shared weights and mean. The colour's gradient
/// is passed directly to the residual, because a saturated activation would make all gradients 0.
template <class Model, class T> Results evaluate(const StabilityInputs<T>& in, ColorActivation activation, int degree) {
    using L = Layout<Model>;
    const T* numbers = in.numbers.data();
    const ViewDirection<T> direction = view_direction(vec3(numbers + L::kView), Vec3<T>{T(0), T(0), T(0)});
    std::vector<T> dL_dparams(L::kBase);  // gradients of the residual's parameters, then of the shared weights
    Vec3<T> dL_ddirection;
    const T *params = numbers, *shared = numbers + L::kShared;
    const Vec3<T> residual = model_residual<Model>(shared, params, direction.unit, degree);
    model_residual_backward<Model>(shared, params, direction.unit, degree, vec3(numbers + L::kGradient),
                                   dL_dparams.data(), dL_ddirection, dL_dparams.data() + L::kShared);
    const Vec3<T> y = vec3(numbers + L::kBase) + residual;
    Results out;
    append(out, residual);
    append(out, activate(activation, y));
    out.insert(out.end(), dL_dparams.begin(), dL_dparams.end());
    append(out, direction_pullback(direction, dL_ddirection));
    // The remaining results only set the scale of the mean's gradient. That gradient is a sum over sites, lobes or
    // bands minus its radial part, and both can cancel.
    append(out, dL_ddirection * direction.inverse_distance);
    T largest = T(0);
    for (const T g : dL_dparams) largest = gs_max(largest, gs_abs(g));
    out.push_back(largest * direction.inverse_distance);
    return out;
}

template <class Model> class Sweep {
    using L = Layout<Model>;

  public:
    Sweep() {
        if (info_.stability) plan_ = info_.stability();
        if (plan_.column_kinds.empty()) plan_.column_kinds.assign(Model::kMaxResidual, "residual");
        groups_ = {0, 0, 0, 1, 1, 1};
        for (int k = 0; k < L::kBase; ++k) groups_.push_back(2 + kind_index(k));
        groups_.insert(groups_.end(), 7, 2 + int(kinds_.size()));
    }

    std::vector<StabilityRow> rows() {
        for (const std::string& kind : kinds_) sweep_kind(kind);
        std::vector<int> base = {L::kBase, L::kBase + 1, L::kBase + 2};
        sweep("base colour", base);
        if (Model::kDirectional) sweep_views();
        for (const StabilityCase& c : plan_.cases) add(c);
        for (StabilityRow& row : rows_)
            if (const auto text = limits_.find(row.kind); text != limits_.end()) row.limit = text->second;
        return std::move(rows_);
    }

  private:
    int kind_index(int number) {
        const std::string kind = number < L::kShared ? plan_.column_kinds.at(number) : kSharedKind;
        const auto found = std::find(kinds_.begin(), kinds_.end(), kind);
        if (found != kinds_.end()) return int(found - kinds_.begin());
        kinds_.push_back(kind);
        return int(kinds_.size()) - 1;
    }

    StabilityRow& row(const std::string& kind) {
        const auto found =
            std::find_if(rows_.begin(), rows_.end(), [&](const StabilityRow& r) { return r.kind == kind; });
        if (found != rows_.end()) return *found;
        rows_.emplace_back();
        rows_.back().model = info_.name, rows_.back().kind = kind;
        return rows_.back();
    }

    /// Returns ordinary inputs: parameters and weights around 1 and below, viewed mostly from 1 to 10 units away.
    StabilityInputs<float> ordinary() {
        StabilityInputs<float> in{std::vector<float>(L::kCount), L::kView};
        for (int k = 0; k < L::kCount; ++k) in.numbers[k] = normal_(random_) * (k < L::kShared ? 1.0f : 0.3f);
        float* view = &in.numbers[L::kView];
        const float scale = std::pow(10.0f, std::abs(normal_(random_)) / 2) / std::hypot(view[0], view[1], view[2]);
        for (int k = 0; k < 3; ++k) view[k] *= scale, in.numbers[L::kGradient + k] *= kTypicalGradient / 0.3f;
        return in;
    }

    Results compare(const StabilityInputs<float>& in, StabilityRow& row) {
        const auto activation = ColorActivation(row.cases % 4);  // all four in turn
        const auto f = [&]<class T>(const StabilityInputs<T>& inputs) {
            return evaluate<Model>(inputs, activation, info_.max_degree_limit);
        };
        return compare_case({f, f, f, groups_, 6, int(groups_.size()) - 4}, in, row);
    }

    void sweep_kind(const std::string& kind) {
        std::vector<int> numbers;
        for (int k = 0; k < L::kBase; ++k)
            if (kinds_[groups_[6 + k] - 2] == kind) numbers.push_back(k);
        sweep(kind, numbers);
    }

    /// Sets one of `numbers` to each value of the sweep, or all of them together with random signs. The other numbers
    /// are ordinary.
    void sweep(const std::string& kind, const std::vector<int>& numbers) {
        StabilityRow& r = row(kind);
        // Many weights share a row of a matrix: testing each of 800 twice would reveal no more than testing 50.
        const int trials = std::clamp(kTrialsPerColumn * int(numbers.size()), kTrials, 100);
        double ends[2] = {};
        for (const float value : stability_sweep()) {
            if (kind == kSharedKind && std::abs(value) > float(kLargestSharedWeight))
                continue;  // a limit that the optimizer enforces
            for (int trial = 0; trial < trials; ++trial) {
                StabilityInputs<float> in = ordinary();
                if (trial % 2 && std::abs(value) <= kLargestTogether)
                    for (const int k : numbers) in.numbers[k] = random_() % 2 ? value : -value;
                else
                    in.numbers[numbers[numbers.size() <= std::size_t(trials) ? trial % numbers.size()
                                                                             : random_() % numbers.size()]] = value;
                const Results result = compare(in, r);
                if (trial == 0 && std::abs(value) == kLargest)
                    ends[value > 0] = double(result[kind == "base colour" ? 3 : 0]);
            }
        }
        r.limit = kind == kSharedKind ? fmt::format("the optimizer keeps them within {:g}", kLargestSharedWeight)
                                      : ends_text(ends[0], ends[1]);
    }

    /// Sweeps axes, planes, directions one rounding away from them, and distances from the camera centre outwards.
    void sweep_views() {
        StabilityRow& r = row("view");
        const float small[] = {0, 1e-38f, 1e-20f, 1e-8f, 1e-7f, 1e-6f, 1e-3f, 1};
        const float lengths[] = {
            0,   std::numeric_limits<float>::denorm_min(), 1e-38f, 1e-20f, 9e-7f, 1e-6f, 1.1e-6f, 1e-5f, 1e-3f, 1, 1e4f,
            1e9f};
        for (int axis = 0; axis < 3; ++axis)
            for (const float sign : {-1.0f, 1.0f})
                for (const float u : small)
                    for (const float v : {0.0f, u, -u})
                        for (const float length : lengths) {
                            StabilityInputs<float> in = ordinary();
                            float* view = &in.numbers[L::kView];
                            view[axis] = sign * length, view[(axis + 1) % 3] = u * length,
                            view[(axis + 2) % 3] = v * length;
                            compare(in, r);
                        }
        r.limit = "direction (0, 0, 1) and no gradient within 1e-6 of the camera centre";
    }

    void add(const StabilityCase& c) {
        StabilityRow& r = row(c.kind);
        StabilityInputs<float> in = ordinary();
        std::copy(c.residual.begin(), c.residual.end(), in.numbers.begin());
        std::copy(c.view.begin(), c.view.end(), in.numbers.begin() + L::kView);
        const Results result = compare(in, r);
        if (!c.limit) return;
        std::string& text = limits_[c.kind];
        const std::string known = c.limit_name + " = ";
        if (text.find(known) == std::string::npos)
            text += (text.empty() ? "" : ", ") + known + fmt::format("{:.4g}", double(result[0]));
        for (int k = 0; k < 3; ++k)
            if (!(std::abs(double(result[k]) - (*c.limit)[k]) <= kLimitTolerance * std::abs((*c.limit)[k]) + 1e-30))
                ++r.num_wrong_limits;
    }

    const ModelInfo& info_ = appearance_model(appearance_name(static_cast<const Model*>(nullptr)));
    StabilityPlan plan_;
    std::vector<std::string> kinds_;
    std::vector<int> groups_;
    std::vector<StabilityRow> rows_;
    std::map<std::string, std::string> limits_;
    std::mt19937 random_{7};
    std::normal_distribution<float> normal_;
};

template <class... Models> std::vector<StabilityRow> sweep_all(const std::vector<std::string>& names) {
    std::vector<std::function<std::vector<StabilityRow>()>> sweeps;
    const auto add = [&]<class Model>(const Model* model) {
        if (std::find(names.begin(), names.end(), appearance_name(model)) != names.end())
            sweeps.push_back([] { return Sweep<Model>().rows(); });
    };
    (add(static_cast<const Models*>(nullptr)), ...);
    std::vector<std::vector<StabilityRow>> by_model(sweeps.size());
    parallel_for(std::int64_t(sweeps.size()),
                 [&](std::int64_t k) { by_model[std::size_t(k)] = sweeps[std::size_t(k)](); });
    std::vector<StabilityRow> all;
    for (auto& rows : by_model) std::move(rows.begin(), rows.end(), std::back_inserter(all));
    return all;
}

}  // namespace

std::vector<StabilityRow> measure_model_stability(const std::vector<std::string>& models) {
    return sweep_all<GS_ALL_APPEARANCE_MODELS>(models);
}

}  // namespace gs
