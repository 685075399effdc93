// SPDX-License-Identifier: Apache-2.0
// Delivers the training views in the order of a run, which it determines, and decodes them ahead of their use.
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

/// A new random permutation of all views in every epoch. It depends only on (seed, iteration), so a resumed run needs
/// no stored state.
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

/// The iterations between log lines, which are also the scans for non-finite parameters: one pass over the model is
/// then below a hundredth of the work. Steps on several views end there.
inline constexpr std::int64_t kLogInterval = 100;

/// Delivers the training views in the order of a run and decodes them ahead of their use. With several views a step
/// set_views_per_step() comes first, then prefetch(), then at() for each iteration.
class TrainingViews {
  public:
    /// The scene must outlive the object.
    TrainingViews(const TrainOptions& options, const Scene& scene);

    /// Sets how many views a step has, and for which of them, by number k, the image is read here. Only images that are
    /// read here are decoded ahead.
    void set_views_per_step(int views_per_step, const std::function<bool(int k)>& is_read_here);

    /// Starts decoding for the iterations from `first` to before `end`.
    void prefetch(std::int64_t first, std::int64_t end, int factor = 1);
    /// Returns the view of the step at `iteration`, with its image reduced `factor` times or without it. Images of
    /// iterations from `end` on are not decoded ahead.
    StepView at(std::int64_t iteration, std::int64_t end, int factor = 1, bool with_image = true);
    /// Returns an image, and decodes ahead the images that this rank needs from `iteration` on.
    std::shared_ptr<const ViewImage> image_of_rank(ImageId id, std::int64_t iteration);

    /// Returns the number of training views.
    std::int64_t count() const { return std::int64_t(scene_.train.size()); }
    /// Returns the mean number of pixels of a training view.
    double mean_pixels() const;
    const View& view_at(std::int64_t iteration) { return scene_.train[order_.at(iteration)]; }
    std::shared_ptr<const ViewImage> image(std::size_t view) { return images_.get(view); }
    double wait_seconds() const { return wait_seconds_; }
    /// Returns the background, RGB; black if the steps' background is random.
    Vec3<float> fixed_background() const { return background_.color; }

  private:
    /// The training views reduced by a factor, whose images come from those of full size.
    struct Reduced {
        std::vector<View> views;
        ImageCache images;
        Reduced(std::vector<View> all, std::size_t budget, int threads)
            : views(std::move(all)), images(views, budget, threads) {}
    };
    ImageCache& images_of(int factor);
    void prefetch_ahead(ImageCache& images, std::int64_t iteration, std::int64_t end);
    /// Returns whether the image of `iteration` is read here, if steps begin at multiples of kLogInterval.
    bool is_read_here(std::int64_t iteration) const {
        return read_here_[std::size_t((iteration % kLogInterval) % std::int64_t(read_here_.size()))];
    }
    /// Returns the number of iterations for which images are decoded ahead: as many of one's own views as if all were
    /// read here.
    std::int64_t num_ahead() const;
    Vec3<float> background_at(std::int64_t iteration) const;

    const std::uint64_t seed_;
    const Device device_;
    const ByteCount cache_;  ///< for decoded images
    const Scene& scene_;
    std::vector<bool> read_here_{true};  ///< by view of a step
    const Background background_;
    ViewOrder order_;
    const std::int64_t prefetch_;  ///< number of views prefetched; never the same view twice
    ViewOrder ahead_{order_};      ///< order for prefetching, where the next epoch may have begun
    ImageCache images_;
    bool began_ = false;                               ///< whether image_of_rank() was called
    double wait_seconds_ = 0;                          ///< of at()
    std::map<int, std::unique_ptr<Reduced>> reduced_;  ///< by factor; destroyed before images_
};

}  // namespace gs
