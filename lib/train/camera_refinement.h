// SPDX-License-Identifier: Apache-2.0
// Learns the cameras of the training views beside the scene: poses, focal lengths, principal points and distortion
// (docs/math/cameras.md).
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/model/checkpoint.h"
#include "lib/scene/scene.h"
#include "lib/train/pose_learner.h"
#include "lib/train/timeline.h"

namespace gs {

/// A similarity of the world, x -> scale * rotation * x + shift.
struct Similarity {
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
    double scale = 1;
    Eigen::Vector3d shift = Eigen::Vector3d::Zero();
};

/// Returns the similarity that brings given cameras to where the same cameras are now on the whole: their mean turn,
/// the ratio of their sizes along the given ones, and the shift of their middle. The scale is 1 if the given cameras
/// are in one place.
Similarity similarity_of(const std::vector<Camera>& given, const std::vector<Camera>& now);

/// How far cameras have moved from where they were given.
struct CameraCorrections {
    std::vector<double> pixels;      ///< by view: root mean square over the points that it sees
    double median = 0, largest = 0;  ///< of these
    double focal = 0;                ///< largest relative change of a focal length
};

/// Learns the cameras of a scene's training views, which it changes in place. Test views with the same lens get the
/// learned lens, and keep their poses.
class CameraRefinement {
  public:
    /// Does nothing unless the options say on (auto is decided before). `scene` must outlive the object.
    CameraRefinement(const TrainOptions& options, Scene& scene);

    bool is_active() const { return !views_.empty(); }
    /// Moves the cameras if enough gradients were gathered. Call it before the requests of each step are made.
    void before_step(Backend& backend, const ScheduleMoment& moment);
    /// Makes a step at `moment` gather the gradients of its cameras if these learn then.
    void gather(std::span<StepRequest> requests, const ScheduleMoment& moment);

    /// Returns what a checkpoint needs, with the gradients gathered so far.
    CameraState state(Backend& backend);
    /// Continues from a checkpoint. Throws DataError if it has other views or cameras.
    void resume(const CameraState& state);

    /// Returns the corrections of all training views.
    CameraCorrections corrections() const;

  private:
    struct LearnedView {
        PoseLearner pose;  ///< from where the training begins: the given pose, or that fitted to the tracks
        std::size_t lens = 0;
        CameraGradient<double> sum{};  ///< of the gradients since the last step
        double count = 0;              ///< number of these gradients
    };
    /// The lens of the images of one camera. A change is the logarithm of the factor of both focal lengths, shifts of
    /// the principal point in pixels, and what is added to the first coefficient of distortion.
    struct LearnedLens {
        LensCamera given;
        LensRange range;
        double num_views = 0;
        Eigen::Vector4d pixel;  ///< the changes that move the image by about a pixel; 0 for what is not learned
        Eigen::Vector4d start = Eigen::Vector4d::Zero();  ///< where the training begins: 0, or fitted to the tracks
        Eigen::Vector4d now = Eigen::Vector4d::Zero();
        double moments[6] = {};  ///< as of adam_direction(), of the changes in pixels
        double ranged = 0;       ///< change of the coefficient, pixels, for which the range was found

        LensCamera learned() const;
        /// Finds the range again if the distortion has changed by a quarter of a pixel.
        void update_range();
    };

    void fit_to_tracks(const std::vector<Eigen::Vector3d>& points);
    bool learns(const ScheduleMoment& moment) const;
    bool has_tracks(std::size_t view) const;
    double error_of_tracks(std::size_t lens) const;
    void collect(Backend& backend);
    void move(double rate);
    void set_lenses();
    void take_back_common_part();
    void take_back_drift();

    Scene& scene_;
    std::int64_t interval_ = 0;  ///< number of gradients between two steps of the cameras
    std::int64_t gathered_ = 0;  ///< number since the last step
    std::vector<LearnedView> views_;
    std::vector<LearnedLens> lenses_;
};

}  // namespace gs
