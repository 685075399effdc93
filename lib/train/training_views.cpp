// SPDX-License-Identifier: Apache-2.0
// Shuffles the views of each epoch, and decodes views ahead of their use.
#include "lib/train/training_views.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <string>
#include <thread>
#include <utility>

#include "kernels/base/clock.h"
#include "kernels/base/rng.h"
#include "lib/core/quantities.h"
#include "lib/scene/resized.h"
#include "lib/train/choose_backend.h"

namespace gs {
namespace {

/// The number of views decoded ahead of the current one, and the number of decoding threads. A GPU needs only a
/// fraction of a view's decoding time and leaves the processor free; the CPU backend needs all of the processor.
int views_ahead(Device device) { return uses_cuda(device) ? 24 : 3; }
int decode_threads(Device device) {
    return uses_cuda(device) ? std::clamp(int(std::thread::hardware_concurrency()) / 2, 1, views_ahead(device)) : 1;
}

}  // namespace

std::size_t ViewOrder::at(std::int64_t iteration) {
    const auto views = static_cast<std::int64_t>(num_views_);
    if (iteration / views != epoch_) {
        epoch_ = iteration / views;
        order_.resize(num_views_);
        std::iota(order_.begin(), order_.end(), std::size_t(0));
        for (std::size_t i = num_views_; i > 1; --i) {  // Fisher-Yates
            const Philox4 r = philox(seed_, RngStream::kViewOrder, std::uint64_t(epoch_), std::uint32_t(i));
            std::swap(order_[i - 1], order_[(std::uint64_t(r.v[0]) * i) >> 32]);
        }
    }
    return order_[iteration % views];
}

TrainingViews::TrainingViews(const TrainOptions& options, const Scene& scene)
    : seed_(options.seed),
      device_(options.device),
      cache_(options.image_cache),
      scene_(scene),
      background_(options.background),
      order_(scene.train.size(), options.seed),
      prefetch_(std::min<std::int64_t>(views_ahead(options.device), std::int64_t(scene.train.size()) / 2 + 1)),
      images_(scene.train, options.image_cache.count, decode_threads(options.device)) {}

void TrainingViews::prefetch(std::int64_t first, std::int64_t end, int factor) {
    ImageCache& images = images_of(factor);
    for (std::int64_t k = first; k < std::min(end, first + num_ahead()); ++k)
        if (is_read_here(k)) images.prefetch(ahead_.at(k));
}

StepView TrainingViews::at(std::int64_t iteration, std::int64_t end, int factor, bool with_image) {
    StepView view{.index = order_.at(iteration), .background = background_at(iteration), .factor = factor};
    ImageCache& images = images_of(factor);
    if (with_image) {
        const double start = seconds_now();
        view.image = images.get(view.index);
        wait_seconds_ += seconds_now() - start;
    }
    prefetch_ahead(images, iteration, end);
    return view;
}

std::shared_ptr<const ViewImage> TrainingViews::image_of_rank(ImageId id, std::int64_t iteration) {
    ImageCache& images = images_of(id.factor);
    if (!std::exchange(began_, true)) prefetch(iteration, std::numeric_limits<std::int64_t>::max(), id.factor);
    auto image = images.get(std::size_t(id.view));
    for (std::size_t k = 0; k < read_here_.size(); ++k)
        prefetch_ahead(images, iteration + std::int64_t(k), std::numeric_limits<std::int64_t>::max());
    return image;
}

void TrainingViews::set_views_per_step(int views_per_step, const std::function<bool(int k)>& is_read_here) {
    read_here_.assign(std::size_t(views_per_step), false);
    for (int k = 0; k < views_per_step; ++k) read_here_[std::size_t(k)] = is_read_here(k);
}

void TrainingViews::prefetch_ahead(ImageCache& images, std::int64_t iteration, std::int64_t end) {
    const std::int64_t next = iteration + num_ahead();
    if (next < end && is_read_here(next)) images.prefetch(ahead_.at(next));
}

std::int64_t TrainingViews::num_ahead() const {
    const auto own = std::max<std::int64_t>(1, std::count(read_here_.begin(), read_here_.end(), true));
    return prefetch_ * std::int64_t(read_here_.size()) / own;
}

ImageCache& TrainingViews::images_of(int factor) {
    if (factor == 1) {
        reduced_.clear();
        return images_;
    }
    auto& found = reduced_[factor];
    if (!found) {
        std::vector<View> views = scene_.train;
        for (std::size_t k = 0; k < views.size(); ++k) {
            View& view = views[k];
            view.camera = reduced(view.camera, factor);
            view.decoded = nullptr;
            view.load = [this, k, width = view.camera.width, height = view.camera.height] {
                return resized(ViewImage(*images_.get(k)), width, height);
            };
        }
        found = std::make_unique<Reduced>(std::move(views), cache_.count, decode_threads(device_));
    }
    return found->images;
}

double TrainingViews::mean_pixels() const {
    double pixels = 0;
    for (const View& view : scene_.train) pixels += double(view.camera.width) * view.camera.height;
    return pixels / double(count());
}

Vec3<float> TrainingViews::background_at(std::int64_t iteration) const {
    if (!background_.random()) return fixed_background();
    const Philox4 r = philox(seed_, RngStream::kBackground, std::uint64_t(iteration), 0);
    return {uniform_from_bits(r.v[0]), uniform_from_bits(r.v[1]), uniform_from_bits(r.v[2])};
}

}  // namespace gs
