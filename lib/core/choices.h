// SPDX-License-Identifier: Apache-2.0
// The options with a fixed set of values: one enum each, and one table of words for command line, files and messages.
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

/// The strategy by which the number of Gaussians changes.
enum class Strategy { kMcmc, kAdc, kNone };
/// The Gaussians that MCMC copies when the model grows; kOpacity: opaque Gaussians, kGradient: opaque Gaussians with
/// large colour gradients.
enum class GrowthBy { kOpacity, kGradient };
/// The scale of a run's schedules; kProgress: relative to the length of the run, kFixed: the iterations of a run of
/// 30,000.
enum class ScheduleKind { kProgress, kFixed };
/// The training recipe; kPaper: the paper's protocol, kFrontier: the best quality in little time, kAuto: kFrontier with
/// a constraint or a preset, else kPaper.
enum class Recipe { kAuto, kPaper, kFrontier };
/// Documented trade-offs between speed and quality.
enum class Preset { kNone, kFast, kBalanced, kBest };
/// The file to which a size limit applies: the scene of a web export, the PLY or the .splat file.
enum class SizeOf { kWeb, kPly, kSplat };
/// The device that trains the model; kAuto: the GPU if there is one, else the CPU.
enum class Device { kAuto, kCpu, kCuda };
/// Whether the photometric correction is learned; kAuto: if held-out images gain by it.
enum class PpispMode { kOff, kOn, kAuto };
/// Whether all images are decoded once before the training; kAuto: unless there are very many images.
enum class VerifyImages { kAuto, kOn, kOff };
/// The meaning of masks; kIgnore: weights of the loss, kTransparent: opacity of the target over the background.
enum class MaskMode { kIgnore, kTransparent };
/// The meaning of the photographs' alpha channel; kTransparent: opacity over the background, kMask: weights of the
/// loss.
enum class AlphaMode { kTransparent, kMask };
/// The treatment of photographs whose lens is no pinhole; kNative: they are used as they are, kUndistort: resampled to
/// a pinhole image, kAuto: as they are only if there is no pinhole image.
enum class LensMode { kAuto, kNative, kUndistort };
/// Whether the model is antialiased; kAuto: as the Gaussians that it begins with.
enum class Antialiasing { kOff, kOn, kAuto };
/// Whether the cameras are learned beside the scene.
enum class RefineCameras { kOff, kAuto, kOn };
/// The precision of the appearance residual when rendering.
enum class AppearanceStorage { kFp32, kFp16 };
/// The precision of Adam's moments for the residual.
enum class AppearanceMoments { kFp32, kBf16 };
/// The Gaussians that a step of the optimizer updates; kVisible: only those visible in the step's view.
enum class Movers { kAll, kVisible };

/// The words of an enum's values, in the order of the values; empty for types other than choices.
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
template <> inline constexpr auto kWordsOf<Antialiasing> = std::to_array<std::string_view>({"off", "on", "auto"});
template <> inline constexpr auto kWordsOf<RefineCameras> = std::to_array<std::string_view>({"off", "auto", "on"});
template <> inline constexpr auto kWordsOf<VerifyImages> = std::to_array<std::string_view>({"auto", "on", "off"});
template <> inline constexpr auto kWordsOf<MaskMode> = std::to_array<std::string_view>({"ignore", "transparent"});
template <> inline constexpr auto kWordsOf<LensMode> = std::to_array<std::string_view>({"auto", "native", "undistort"});
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

/// Returns the word of a value.
template <Choice T> constexpr std::string word(T value) { return std::string(kWordsOf<T>[std::size_t(value)]); }

/// Returns all words, in the order of the values.
template <Choice T> std::vector<std::string> words() { return {kWordsOf<T>.begin(), kWordsOf<T>.end()}; }

/// Returns the value of a word; nothing if there is no such word.
template <Choice T> constexpr std::optional<T> choice_of(std::string_view text) {
    for (std::size_t i = 0; i < kWordsOf<T>.size(); ++i)
        if (kWordsOf<T>[i] == text) return T(int(i));
    return std::nullopt;
}

/// Prints the word, also in messages of tests.
template <Choice T> std::ostream& operator<<(std::ostream& out, T value) { return out << word(value); }

}  // namespace gs
