// SPDX-License-Identifier: Apache-2.0
// Decodes views in parallel and removes or reports the failed ones.
#include "lib/scene/verify_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/scene/source_scene.h"

namespace gs {
namespace {

std::size_t bytes_of_images(const std::vector<View>& views) {
    std::size_t bytes = 0;
    for (const View& view : views) bytes += view.image_bytes;
    return bytes;
}

/// Returns "2 of 40 test images cannot be decoded (first reason; ...)", or an empty string if all can.
std::string failures(const char* kind, const std::vector<std::string>& errors) {
    const auto failed = [](const std::string& error) { return !error.empty(); };
    const auto count = std::count_if(errors.begin(), errors.end(), failed);
    if (count == 0) return "";
    return fmt::format("{} of {} {} images cannot be decoded ({}{})", count, errors.size(), kind,
                       *std::find_if(errors.begin(), errors.end(), failed), count > 1 ? "; ..." : "");
}

/// Returns the largest weight in a view's mask, 0..1. With MaskMode::kTransparent the weights are in the alpha channel.
float largest_weight(const ViewImage& image) {
    if (image.mask) return float(*std::max_element(image.mask->u8.begin(), image.mask->u8.end())) / 255.0f;
    float largest = 0;
    for (int y = 0; y < image.color.height; ++y)
        for (int x = 0; x < image.color.width; ++x) largest = std::max(largest, image.color.value(x, y, 3));
    return largest;
}

/// Adds notes about masks that give an image little or no weight. `weights` holds the largest weight of each of
/// `views`, or nothing for views without a mask and for views that cannot be decoded.
void note_dark_masks(const std::vector<const View*>& views, const std::vector<std::optional<float>>& weights,
                     std::vector<std::string>& notes) {
    constexpr float kDark = 0.5f;  // white is 1
    std::vector<std::string> black, dark;
    std::size_t masks = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
        masks += !views[i]->mask_file.empty();
        if (weights[i] && *weights[i] < kDark) (*weights[i] > 0 ? dark : black).push_back(views[i]->mask_file);
    }
    if (!black.empty())
        notes.push_back(
            fmt::format("{} of {} masks are all black, or all white with --invert-masks: nothing is learned "
                        "from their images ({})",
                        black.size(), masks, listed(black)));
    if (!dark.empty())
        notes.push_back(
            fmt::format("{} of {} masks are dark all over: their images count little, for only white has "
                        "full weight ({})",
                        dark.size(), masks, listed(dark)));
}

}  // namespace

void verify_images(Scene& scene, std::size_t keep_bytes,
                   const std::function<void(std::int64_t, std::int64_t)>& progress) {
    const std::size_t train_bytes = bytes_of_images(scene.train);
    const bool keep_train = train_bytes <= keep_bytes,
               keep_test = train_bytes + bytes_of_images(scene.test) <= keep_bytes;
    std::vector<std::string> train_errors(scene.train.size()), test_errors(scene.test.size());
    const std::int64_t num_train = std::int64_t(scene.train.size()),
                       total = num_train + std::int64_t(scene.test.size());
    std::vector<const View*> views(static_cast<std::size_t>(total));
    std::vector<std::optional<float>> weights(views.size());
    std::mutex mutex;
    std::int64_t done = 0;
    parallel_for(total, [&](std::int64_t i) {
        const bool train = i < num_train;
        const std::size_t k = std::size_t(train ? i : i - num_train);
        View& view = (train ? scene.train : scene.test)[k];
        views[std::size_t(i)] = &view;
        try {
            auto image = view_image(view);
            if (!view.mask_file.empty()) weights[std::size_t(i)] = largest_weight(*image);
            if (train ? keep_train : keep_test) view.decoded = std::move(image);
        } catch (const DataError& error) {
            (train ? train_errors : test_errors)[k] = error.what();
        }
        const std::lock_guard lock(mutex);
        progress(++done, total);
    });
    note_dark_masks(views, weights, scene.notes);
    if (const std::string text = failures("test", test_errors); !text.empty())
        throw DataError(scene.source + ": " + text +
                        ": scores without them would not be comparable; repair the files, or take the views out of "
                        "the scene");
    const std::string text = failures("training", train_errors);
    if (text.empty()) return;
    std::vector<bool> unusable;
    for (const std::string& error : train_errors) unusable.push_back(!error.empty());
    if (std::find(unusable.begin(), unusable.end(), false) == unusable.end())
        throw DataError(scene.source + ": " + text);
    remove_training_views(scene, unusable);
    scene.notes.push_back(text + ": skipped");
}

}  // namespace gs
