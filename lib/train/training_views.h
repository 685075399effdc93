// SPDX-License-Identifier: Apache-2.0
// Determines the order of the training views in a run, returns them in that order, and decodes them ahead of use.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "lib/core/options.h"
#include "lib/core/train_options.h"
#include "lib/scene/image_cache.h"
#include "lib/scene/scene.h"
#include "lib/train/step_composer.h"

namespace gs {

/// The order of the views: a new random permutation in every epoch. It depends only on (seed, iteration), so a resumed
/// run needs no stored state.
class ViewOrder {
  public:
    ViewOrder(std::size_t num_views, std::uint64_t seed) : num_views_(num_views), seed_(seed) {}
    std::size_t at(std::int64_t iteration);

  private:
    std::size_t num_views_;
    std::uint64_t seed_;
    std::int64_t epoch_ = -1;
    std::vector<std::size_t> order_;  ///< permutation of `epoch_`
};

/// The number of iterations between two log lines and between two scans for non-finite parameters. With this interval a
/// scan, one pass over the model, is less than a hundredth of the work. Steps on several views end at its multiples.
inline constexpr std::int64_t kLogInterval = 100;

/// Returns the training views in the order of a run and decodes them ahead of use. With several views per step call
/// set_views_per_step() first; then prefetch(), then at() for each iteration.
class TrainingViews {
  public:
    /// The scene must outlive the object.
    TrainingViews(const TrainOptions& options, const Scene& scene);

    /// Sets the number of views per step, and `is_read_here`, which returns whether this process reads the image of
    /// view k of a step. Only these images are decoded ahead.
    void set_views_per_step(int views_per_step, const std::function<bool(int k)>& is_read_here);

    /// Starts decoding the images of the first iterations in [first, end).
    void prefetch(std::int64_t first, std::int64_t end, int factor = 1);
    /// Returns the view of the step at `iteration`, with its image reduced by `factor`, or without its image. Images of
    /// iterations >= `end` are not decoded ahead.
    StepView at(std::int64_t iteration, std::int64_t end, int factor = 1, bool with_image = true);
    /// Returns the image `id`, and decodes ahead the images that this rank needs from `iteration` on.
    std::shared_ptr<const ViewImage> image_of_rank(ImageId id, std::int64_t iteration);

    /// Returns the number of training views.
    std::int64_t count() const { return std::int64_t(scene_.train.size()); }
    /// Returns the mean number of pixels of a training view.
    double mean_pixels() const;
    const View& view_at(std::int64_t iteration) { return scene_.train[order_.at(iteration)]; }
    std::shared_ptr<const ViewImage> image(std::size_t view) { return images_.get(view); }
    double wait_seconds() const { return wait_seconds_; }
    /// Returns the RGB background; black if the steps use random backgrounds.
    Vec3<float> fixed_background() const { return background_.color; }

  private:
    /// The training views reduced by a factor; their images are made from the full-size images.
    struct Reduced {
        std::vector<View> views;
        ImageCache images;
        Reduced(std::vector<View> all, std::size_t budget, int threads)
            : views(std::move(all)), images(views, budget, threads) {}
    };
    ImageCache& images_of(int factor);
    void prefetch_ahead(ImageCache& images, std::int64_t iteration, std::int64_t end);
    /// Returns whether this process reads the image of `iteration`, counting the views of steps from each multiple of
    /// kLogInterval.
    bool is_read_here(std::int64_t iteration) const {
        return read_here_[std::size_t((iteration % kLogInterval) % std::int64_t(read_here_.size()))];
    }
    /// Returns the number of iterations for which images are decoded ahead. It keeps the number of views decoded by
    /// this process the same as if this process read all images.
    std::int64_t num_ahead() const;
    Vec3<float> background_at(std::int64_t iteration) const;

    const std::uint64_t seed_;
    const Device device_;
    const ByteCount cache_;  ///< memory for decoded images
    const Scene& scene_;
    std::vector<bool> read_here_{true};  ///< index: view of a step
    const Background background_;
    ViewOrder order_;
    const std::int64_t prefetch_;  ///< number of views decoded ahead, so small that no view occurs twice
    ViewOrder ahead_{order_};      ///< order for decoding ahead, in which the next epoch may have begun
    ImageCache images_;
    bool began_ = false;                               ///< whether image_of_rank() was called
    double wait_seconds_ = 0;                          ///< time that at() waited for images
    std::map<int, std::unique_ptr<Reduced>> reduced_;  ///< views by reduction factor; destroyed before images_
};

}  // namespace gs
