// SPDX-License-Identifier: Apache-2.0
// Decodes in parallel and sorts out what failed.
#include "lib/scene/verify_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <string>
#include <vector>

#include "kernels/core/error.h"
#include "kernels/core/parallel.h"

namespace gs {
namespace {

std::size_t bytes_of_images(const std::vector<View>& views) {
    std::size_t bytes = 0;
    for (const View& view : views) bytes += view.image_bytes;
    return bytes;
}

/// Returns "2 of 40 test images cannot be decoded (first reason; ...)", or nothing if all can.
std::string failures(const char* kind, const std::vector<std::string>& errors) {
    const auto failed = [](const std::string& error) { return !error.empty(); };
    const auto count = std::count_if(errors.begin(), errors.end(), failed);
    if (count == 0) return "";
    return fmt::format("{} of {} {} images cannot be decoded ({}{})", count, errors.size(), kind,
                       *std::find_if(errors.begin(), errors.end(), failed), count > 1 ? "; ..." : "");
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
    std::mutex mutex;
    std::int64_t done = 0;
    parallel_for(total, [&](std::int64_t i) {
        const bool train = i < num_train;
        const std::size_t k = std::size_t(train ? i : i - num_train);
        View& view = (train ? scene.train : scene.test)[k];
        try {
            auto image = view_image(view);
            if (train ? keep_train : keep_test) view.decoded = std::move(image);
        } catch (const DataError& error) {
            (train ? train_errors : test_errors)[k] = error.what();
        }
        const std::lock_guard lock(mutex);
        progress(++done, total);
    });
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
