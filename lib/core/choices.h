// SPDX-License-Identifier: Apache-2.0
// The closed choices among the options: one enum each, and one table of words for command line, files and messages.
#pragma once

#include <array>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "kernels/base/appearance_spec.h"

namespace gs {

/// How the number of Gaussians changes.
enum class Strategy { kMcmc, kAdc, kNone };
/// Which Gaussians MCMC copies where the model grows; kOpacity: opaque ones, kGradient: those among them whose colour
/// has large gradients.
enum class GrowthBy { kOpacity, kGradient };
/// What the schedules of a run follow; kProgress: its length, kFixed: the iterations of a run of 30,000.
enum class ScheduleKind { kProgress, kFixed };
/// How a scene is trained; kPaper: by the paper's protocol, kFrontier: for the most quality in little time, kAuto: the
/// latter if a constraint or a preset asks for it.
enum class Recipe { kAuto, kPaper, kFrontier };
/// Documented points between speed and quality.
enum class Preset { kNone, kFast, kBalanced, kBest };
/// The file that a size limit is for: the scene of a web export, the PLY, the .splat file.
enum class SizeOf { kWeb, kPly, kSplat };
/// Where the model is trained; kAuto: on the GPU if there is one.
enum class Device { kAuto, kCpu, kCuda };
/// Whether the photometric correction is learned; kAuto: where images turn out to differ.
enum class PpispMode { kOff, kOn, kAuto };
/// Whether all images are decoded before the training; kAuto: unless there are very many.
enum class VerifyImages { kAuto, kOn, kOff };
/// What masks mean; kIgnore: weights of the loss, kTransparent: the target composited on the background.
enum class MaskMode { kIgnore, kTransparent };
/// What the alpha channel of photographs means; kMask: weights of the loss.
enum class AlphaMode { kTransparent, kMask };
/// The precision in which frames read the residual of the appearance.
enum class AppearanceStorage { kFp32, kFp16 };
/// The precision of Adam's moments of the residual.
enum class AppearanceMoments { kFp32, kBf16 };
/// The Gaussians that take a step of the optimizer; kVisible: those that its view shows.
enum class Movers { kAll, kVisible };

/// The words of an enum's values, in the order of the values; empty for types that are no choice.
template <class T> inline constexpr std::array<std::string_view, 0> kWordsOf = {};
template <> inline constexpr auto kWordsOf<Strategy> = std::to_array<std::string_view>({"mcmc", "adc", "none"});
template <> inline constexpr auto kWordsOf<GrowthBy> = std::to_array<std::string_view>({"opacity", "gradient"});
template <> inline constexpr auto kWordsOf<ScheduleKind> = std::to_array<std::string_view>({"progress", "fixed"});
template <> inline constexpr auto kWordsOf<Recipe> = std::to_array<std::string_view>({"auto", "paper", "frontier"});
template <>
inline constexpr auto kWordsOf<Preset> = std::to_array<std::string_view>({"none", "fast", "balanced", "best"});
template <> inline constexpr auto kWordsOf<SizeOf> = std::to_array<std::string_view>({"web", "ply", "splat"});
template <> inline constexpr auto kWordsOf<Device> = std::to_array<std::string_view>({"auto", "cpu", "cuda"});
template <> inline constexpr auto kWordsOf<PpispMode> = std::to_array<std::string_view>({"off", "on", "auto"});
template <> inline constexpr auto kWordsOf<VerifyImages> = std::to_array<std::string_view>({"auto", "on", "off"});
template <> inline constexpr auto kWordsOf<MaskMode> = std::to_array<std::string_view>({"ignore", "transparent"});
template <> inline constexpr auto kWordsOf<AlphaMode> = std::to_array<std::string_view>({"transparent", "mask"});
template <> inline constexpr auto kWordsOf<AppearanceStorage> = std::to_array<std::string_view>({"fp32", "fp16"});
template <> inline constexpr auto kWordsOf<Movers> = std::to_array<std::string_view>({"all", "visible"});
template <> inline constexpr auto kWordsOf<AppearanceMoments> = std::to_array<std::string_view>({"fp32", "bf16"});
template <>
inline constexpr auto kWordsOf<ColorActivation> = std::to_array<std::string_view>({"relu", "softplus", "sigmoid",
                                                                                   "hardsigmoid"});

/// An enum with a table of words.
template <class T>
concept Choice = std::is_enum_v<T> && kWordsOf<T>
.size() > 0;

/// The word of a value.
template <Choice T> constexpr std::string word(T value) { return std::string(kWordsOf<T>[std::size_t(value)]); }

/// All words, in the order of the values.
template <Choice T> std::vector<std::string> words() { return {kWordsOf<T>.begin(), kWordsOf<T>.end()}; }

/// The value of a word; empty if there is no such word.
template <Choice T> constexpr std::optional<T> choice_of(std::string_view text) {
    for (std::size_t i = 0; i < kWordsOf<T>.size(); ++i)
        if (kWordsOf<T>[i] == text) return T(int(i));
    return std::nullopt;
}

/// Prints the word, in messages of tests too.
template <Choice T> std::ostream& operator<<(std::ostream& out, T value) { return out << word(value); }

}  // namespace gs
