// SPDX-License-Identifier: Apache-2.0
// Gathers the gradients of cameras, and moves all cameras of a scene together.
#include "lib/train/camera_refinement.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <utility>

#include "kernels/base/error.h"
#include "lib/core/log.h"
#include "lib/core/median.h"
#include "lib/model/initialize.h"

namespace gs {
namespace {

using Eigen::Matrix3d, Eigen::Vector3d;

// Cameras learn once there is geometry, and stop while the scene can still settle.
constexpr double kFrom = 1000, kUntil = 24000;
/// How far a camera can go along each direction, pixels. The rate follows from it and from the number of steps.
constexpr double kTravel = 6, kLargestRate = 0.25;
/// The pull of a camera towards where it began, per pixel, with and without COLMAP's tracks.
constexpr double kPullWithTracks = 0.1, kPullWithoutTracks = 2e-3;
/// The fewest tracks of an image that hold its camera.
constexpr std::size_t kFewestTracks = 20;
/// The least pull of focal length and principal point. Another focal length is nearly the same as other distances of
/// the cameras, and another principal point as a turn of all of them, which the poses can learn.
constexpr double kPullOfFocal = 0.01, kPullOfPrincipalPoint = 0.02;
/// Points of the scene from which the coordinates of poses follow.
constexpr std::int64_t kPoints = 5000;
/// How far the logarithm of a focal length may go.
constexpr double kMostLogFocal = 0.1;
/// Number of images of a camera with which its lens learns at the full rate.
constexpr double kViewsOfLens = 8;

std::vector<Vector3d> some_points(const TrainOptions& options, const Scene& scene) {
    InitOptions init = init_options(options);
    init.most_points = kPoints;
    std::vector<Vector3d> points;
    for (const Eigen::Vector3f& point : initial_points(scene, init).positions) points.push_back(point.cast<double>());
    return points;
}

}  // namespace

Similarity similarity_of(const std::vector<Camera>& given, const std::vector<Camera>& now) {
    Similarity out;
    if (given.empty()) return out;
    Matrix3d turn = Matrix3d::Zero();
    Vector3d middle = Vector3d::Zero(), middle_now = Vector3d::Zero();
    for (std::size_t k = 0; k < given.size(); ++k) {
        turn += now[k].rotation.transpose() * given[k].rotation;
        middle += given[k].center() / double(given.size()), middle_now += now[k].center() / double(given.size());
    }
    const Eigen::JacobiSVD<Matrix3d> svd(turn, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant();
    out.rotation = svd.matrixU() * Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
    double along = 0, size = 0, farthest = 0;
    for (std::size_t k = 0; k < given.size(); ++k) {
        const Vector3d off = given[k].center() - middle;
        along += (now[k].center() - middle_now).dot(out.rotation * off);
        size += off.squaredNorm();
        farthest = std::max(farthest, given[k].center().norm());
    }
    if (size > 1e-12 * farthest * farthest && along > 0) out.scale = along / size;
    out.shift = middle_now - out.scale * (out.rotation * middle);
    return out;
}

LensCamera CameraRefinement::LearnedLens::learned() const {
    LensCamera lens = given;
    lens.fx *= std::exp(now.log_focal), lens.fy *= std::exp(now.log_focal);
    lens.cx += now.cx, lens.cy += now.cy;
    return lens;
}

CameraRefinement::CameraRefinement(const TrainOptions& options, Scene& scene) : scene_(scene) {
    if (options.refine_cameras != RefineCameras::kOn) return;
    const std::vector<Vector3d> points = some_points(options, scene);
    views_.resize(scene.train.size());
    for (std::size_t k = 0; k < views_.size(); ++k) {
        View& view = scene.train[k];
        if (!view.given) view.given = std::make_shared<const Camera>(view.camera);
        const Camera& camera = view.camera = *view.given;
        views_[k].pose = PoseLearner(camera, points);
        const auto same = std::find_if(lenses_.begin(), lenses_.end(), [&](const LearnedLens& lens) {
            return lens.given == static_cast<const LensCamera&>(camera);
        });
        views_[k].lens = std::size_t(same - lenses_.begin());
        if (same == lenses_.end()) lenses_.push_back({.given = camera});
        ++lenses_[views_[k].lens].num_views;
    }
    interval_ = std::clamp<std::int64_t>(std::int64_t(views_.size()), 10, 100);
    fit_to_tracks(points);
}

/// Returns whether the cameras learn in a step at `moment`.
bool CameraRefinement::learns(const ScheduleMoment& moment) const {
    return is_active() && moment.position >= kFrom && moment.position < kUntil;
}

void CameraRefinement::before_step(Backend& backend, const ScheduleMoment& moment) {
    if (gathered_ < interval_) return;
    collect(backend);
    gathered_ = 0;
    const double steps = (kUntil - kFrom) / (moment.pace * double(std::max<std::size_t>(views_.size(), interval_)));
    const double share = (moment.position - kFrom) / (kUntil - kFrom);
    move(falling_rate(std::min(2 * kTravel / steps, kLargestRate), share));
}

void CameraRefinement::gather(std::span<StepRequest> requests, const ScheduleMoment& moment) {
    if (!learns(moment)) return;
    for (StepRequest& request : requests) request.gather_camera_gradient = true;
    gathered_ += std::int64_t(requests.size());
}

/// Adds the gradients that the backend has gathered to those of the views.
void CameraRefinement::collect(Backend& backend) {
    for (const ViewCameraGradient& found : backend.take_camera_gradients()) {
        LearnedView& view = views_[std::size_t(found.id.view)];
        CameraGradient<double> gradient = found.gradient;
        // A pixel of a reduced image is several of the camera's.
        const double pixel = 1.0 / found.id.factor;
        double numbers[CameraGradient<double>::kSize];
        gradient.for_each([&](int k, double number) { numbers[k] = k < 6 ? number : number * pixel; });
        view.sum.for_each([&](int k, double& sum) { sum += numbers[k]; });
        ++view.count;
    }
}

/// Returns the pull of a view's camera towards its start, where COLMAP's own poses fit its tracks best.
double CameraRefinement::pull_of(std::size_t view) const {
    return scene_.train[view].observations.size() < kFewestTracks ? kPullWithoutTracks : kPullWithTracks;
}

/// Takes a step of all cameras that have gradients.
void CameraRefinement::move(double rate) {
    struct LensSum {
        double gradient[3] = {}, pull = 0, count = 0;
    };
    std::vector<LensSum> sums(lenses_.size());
    for (std::size_t k = 0; k < views_.size(); ++k) {
        LearnedView& view = views_[k];
        if (view.count == 0) continue;
        Camera& camera = scene_.train[k].camera;
        const double mean = 1 / view.count;
        const CameraGradient<double>& sum = view.sum;
        LensSum& lens = sums[view.lens];
        lens.gradient[0] += mean * (sum.fx * camera.fx + sum.fy * camera.fy);
        lens.gradient[1] += mean * sum.cx;
        lens.gradient[2] += mean * sum.cy;
        lens.pull += pull_of(k);
        ++lens.count;
        view.pose.step(camera, mean * pose_gradient(camera, view.sum), rate, pull_of(k), largest_correction(camera));
        view.sum = {}, view.count = 0;
    }
    for (std::size_t k = 0; k < lenses_.size(); ++k) {
        LearnedLens& lens = lenses_[k];
        if (sums[k].count == 0 || lens.given.model == CameraModel::kEquirectangular) continue;
        double gradient[3], direction[3];
        for (int i = 0; i < 3; ++i) gradient[i] = sums[k].gradient[i] / sums[k].count;
        gradient[0] /= lens.radius();
        if (!std::isfinite(gradient[0] + gradient[1] + gradient[2])) continue;
        const double root = adam_direction(lens.moments, 3, gradient, direction);
        if (root == 0) continue;
        const double of_lens = rate * std::min(1.0, lens.num_views / kViewsOfLens);
        const double most = largest_correction(lens.given);
        const auto step = [&](double& value, double start, int i, double unit, double pull, double bound) {
            const double way = value - start - of_lens * direction[i] * unit;
            value = start + std::clamp(way * share_after_pull(way / unit, pull, of_lens, root), -bound, bound);
        };
        const double pull = sums[k].pull / sums[k].count, of_point = std::max(pull, kPullOfPrincipalPoint);
        step(lens.now.log_focal, lens.start.log_focal, 0, 1 / lens.radius(), std::max(pull, kPullOfFocal),
             kMostLogFocal);
        step(lens.now.cx, lens.start.cx, 1, 1, of_point, most);
        step(lens.now.cy, lens.start.cy, 2, 1, of_point, most);
    }
    set_lenses();
    take_back_common_part();
    take_back_drift();
}

/// Gives the cameras of the scene the learned lenses, those of test images with the same lens, too.
void CameraRefinement::set_lenses() {
    for (std::size_t k = 0; k < views_.size(); ++k)
        static_cast<LensCamera&>(scene_.train[k].camera) = lenses_[views_[k].lens].learned();
    for (View& view : scene_.test) {
        const LensCamera given = view.given ? *view.given : view.camera;
        for (const LearnedLens& lens : lenses_) {
            if (lens.given != given) continue;
            if (!view.given) view.given = std::make_shared<const Camera>(view.camera);
            static_cast<LensCamera&>(view.camera) = lens.learned();
        }
    }
}

/// Returns the mean error of the tracks of a lens's images; 0 without tracks.
double CameraRefinement::error_of_tracks(std::size_t lens) const {
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < views_.size(); ++k) {
        const auto& observations = scene_.train[k].observations;
        if (views_[k].lens != lens || observations.empty()) continue;
        sum += track_error(scene_.train[k].camera, observations).mean * double(observations.size());
        count += double(observations.size());
    }
    return count > 0 ? sum / count : 0;
}

/// Moves the cameras to where they fit the tracks best, lens by lens, if they fit clearly better there: the dataset's
/// poses may not be those with which its points were found. The training then begins there.
void CameraRefinement::fit_to_tracks(const std::vector<Vector3d>& points) {
    constexpr int kRounds = 10;
    constexpr double kDamping = 1e-4, kClearly = 0.9;
    using Matrix63 = Eigen::Matrix<double, 6, 3>;
    for (std::size_t l = 0; l < lenses_.size(); ++l) {
        const double before = error_of_tracks(l);
        if (before == 0) continue;
        const LearnedLens lens_before = lenses_[l];
        std::vector<Camera> cameras_before;
        for (const View& view : scene_.train) cameras_before.push_back(view.camera);
        for (int round = 0; round < kRounds; ++round) {
            // The poses are eliminated from the normal equations.
            Matrix3d of_lens = Matrix3d::Zero();
            Vector3d toward_lens = Vector3d::Zero();
            std::vector<std::pair<Vector6d, Matrix63>> of_poses(views_.size(), {Vector6d::Zero(), Matrix63::Zero()});
            for (std::size_t k = 0; k < views_.size(); ++k) {
                const auto& observations = scene_.train[k].observations;
                if (views_[k].lens != l || observations.size() < kFewestTracks) continue;
                TrackError error = track_error(scene_.train[k].camera, observations);
                error.hessian.diagonal() *= 1 + kDamping;
                const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> pose(error.hessian.topLeftCorner<6, 6>());
                const Matrix63 mixed = error.hessian.topRightCorner<6, 3>();
                of_poses[k] = {pose.solve(error.gradient.head<6>()), pose.solve(mixed)};
                of_lens += error.hessian.bottomRightCorner<3, 3>() - mixed.transpose() * of_poses[k].second;
                toward_lens += error.gradient.tail<3>() - mixed.transpose() * of_poses[k].first;
            }
            const Vector3d by_lens = -of_lens.ldlt().solve(toward_lens);
            if (!by_lens.allFinite()) break;
            LensChange& lens = lenses_[l].now;
            lens.log_focal += by_lens[0], lens.cx += by_lens[1], lens.cy += by_lens[2];
            for (std::size_t k = 0; k < views_.size(); ++k) {
                const Vector6d by = -(of_poses[k].first + of_poses[k].second * by_lens);
                if (views_[k].lens == l && by.allFinite() && !by.isZero(0))
                    scene_.train[k].camera = moved_by(scene_.train[k].camera, by);
            }
            set_lenses();
        }
        if (error_of_tracks(l) < kClearly * before) {
            lenses_[l].start = lenses_[l].now;
            for (std::size_t k = 0; k < views_.size(); ++k)
                if (views_[k].lens == l) views_[k].pose = PoseLearner(scene_.train[k].camera, points);
            continue;
        }
        lenses_[l] = lens_before;
        for (std::size_t k = 0; k < views_.size(); ++k) scene_.train[k].camera = cameras_before[k];
        set_lenses();
    }
}

/// Takes back the mean correction, in the cameras' own axes, of all cameras with one lens: test images with this lens
/// would need it, too.
void CameraRefinement::take_back_common_part() {
    std::vector<Vector6d> sums(lenses_.size(), Vector6d::Zero());
    for (std::size_t k = 0; k < views_.size(); ++k)
        sums[views_[k].lens] += correction_of(views_[k].pose.start(), scene_.train[k].camera);
    for (std::size_t k = 0; k < views_.size(); ++k) {
        const LearnedLens& lens = lenses_[views_[k].lens];
        if (lens.num_views < kViewsOfLens) continue;
        scene_.train[k].camera = moved_by(scene_.train[k].camera, -sums[views_[k].lens] / lens.num_views);
    }
}

/// Takes back the similarity by which the cameras have moved on the whole, so that place, orientation and size of the
/// scene stay.
void CameraRefinement::take_back_drift() {
    std::vector<Camera> given, now;
    for (const LearnedView& view : views_) given.push_back(view.pose.start());
    for (const View& view : scene_.train) now.push_back(view.camera);
    const Similarity drift = similarity_of(given, now);
    for (View& view : scene_.train) {
        const Vector3d center = drift.rotation.transpose() * (view.camera.center() - drift.shift) / drift.scale;
        view.camera.rotation = view.camera.rotation * drift.rotation;
        view.camera.translation = -(view.camera.rotation * center);
    }
}

CameraCorrections CameraRefinement::corrections() const {
    CameraCorrections out;
    for (std::size_t k = 0; k < views_.size(); ++k)
        out.pixels.push_back(views_[k].pose.pixels(*scene_.train[k].given, scene_.train[k].camera));
    for (const double pixels : out.pixels) out.largest = std::max(out.largest, pixels);
    if (!out.pixels.empty()) out.median = median(out.pixels);
    for (const LearnedLens& lens : lenses_) out.focal = std::max(out.focal, std::abs(std::expm1(lens.now.log_focal)));
    return out;
}

CameraState CameraRefinement::state(Backend& backend) {
    CameraState state;
    if (!is_active()) return state;
    collect(backend);
    state.gathered = gathered_;
    for (std::size_t k = 0; k < views_.size(); ++k) {
        LearnedView& view = views_[k];
        const Camera& camera = scene_.train[k].camera;
        auto& row = state.views.emplace_back();
        for (int i = 0; i < 9; ++i) row.push_back(camera.rotation(i / 3, i % 3));
        for (int i = 0; i < 3; ++i) row.push_back(camera.translation[i]);
        row.insert(row.end(), view.pose.moments(), view.pose.moments() + PoseLearner::kMoments);
        view.sum.for_each([&](int, double sum) { row.push_back(sum); });
        row.push_back(view.count);
    }
    for (const LearnedLens& lens : lenses_) {
        auto& row = state.lenses.emplace_back(std::vector<double>{lens.now.log_focal, lens.now.cx, lens.now.cy});
        row.insert(row.end(), std::begin(lens.moments), std::end(lens.moments));
    }
    return state;
}

void CameraRefinement::resume(const CameraState& state) {
    if (state.views.empty()) return;
    if (!is_active()) {
        log_warning("the checkpoint has learned cameras, which are not used: --refine-cameras is off");
        return;
    }
    if (state.views.size() != views_.size() || state.lenses.size() != lenses_.size())
        throw DataError(fmt::format("the checkpoint has refined {} views of {} cameras, the scene has {} of {}",
                                    state.views.size(), state.lenses.size(), views_.size(), lenses_.size()));
    gathered_ = state.gathered;
    for (std::size_t k = 0; k < lenses_.size(); ++k) {
        const double* at = state.lenses[k].data();
        LensChange& lens = lenses_[k].now;
        lens.log_focal = *at++, lens.cx = *at++, lens.cy = *at++;
        for (double& moment : lenses_[k].moments) moment = *at++;
    }
    for (std::size_t k = 0; k < views_.size(); ++k) {
        LearnedView& view = views_[k];
        Camera& camera = scene_.train[k].camera;
        const double* at = state.views[k].data();
        for (int i = 0; i < 9; ++i) camera.rotation(i / 3, i % 3) = *at++;
        for (int i = 0; i < 3; ++i) camera.translation[i] = *at++;
        for (int i = 0; i < PoseLearner::kMoments; ++i) view.pose.moments()[i] = *at++;
        view.sum.for_each([&](int, double& sum) { sum = *at++; });
        view.count = *at++;
    }
    set_lenses();
}

}  // namespace gs
