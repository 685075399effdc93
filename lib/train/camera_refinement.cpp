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
/// The pull of each part of a lens without tracks. Another principal point is nearly the same as a turn of all cameras,
/// which the poses can learn.
constexpr double kPullOfLens[] = {3e-4, 0.02, 0.02, 2e-3};
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

/// Returns the changes of a lens (CameraRefinement::LearnedLens) that move pixels by one in the root mean square. 0 for
/// what a model does not have.
Eigen::Vector4d changes_of_a_pixel(const Camera& camera) {
    if (camera.model == CameraModel::kEquirectangular) return Eigen::Vector4d::Zero();
    Eigen::Vector4d out(1 / (0.3 * std::hypot(camera.width, camera.height)), 1, 1, 0);
    constexpr int kPlaces = 9;
    double squares = 0, count = 0;
    // FOV is the same lens for angles of both signs, and gradients are by the positive one.
    if (is_pinhole(camera) || (camera.model == CameraModel::kFov && camera.distortion[0] <= 0)) return out;
    for (int k = 0; k < kPlaces * kPlaces; ++k) {
        const auto ray = unproject(
            camera, {camera.width * (k % kPlaces + 0.5) / kPlaces, camera.height * (k / kPlaces + 0.5) / kPlaces});
        if (ray) squares += pixel_by_coefficient(camera, *ray).squaredNorm(), ++count;
    }
    if (squares > 0) out[3] = std::sqrt(count / squares);
    return out;
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
    lens.fx *= std::exp(now[0]), lens.fy *= std::exp(now[0]);
    lens.cx += now[1], lens.cy += now[2];
    lens.distortion[0] += now[3];
    return lens;
}

void CameraRefinement::LearnedLens::update_range() {
    constexpr double kStep = 0.25;
    if (pixel[3] == 0) return;
    // Rounded, so that a resumed training finds the same range.
    const double step = kStep * std::round(now[3] / (kStep * pixel[3]));
    if (step == ranged) return;
    LensCamera lens = given;
    lens.distortion[0] += step * pixel[3];
    range = lens_range(lens);
    ranged = step;
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
        if (same == lenses_.end())
            lenses_.push_back({.given = camera, .range = camera.range, .pixel = changes_of_a_pixel(camera)});
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
        for (double* per_pixel : {&gradient.fx, &gradient.fy, &gradient.cx, &gradient.cy})
            *per_pixel /= found.id.factor;
        double numbers[CameraGradient<double>::kSize];
        gradient.for_each([&](int k, double number) { numbers[k] = number; });
        view.sum.for_each([&](int k, double& sum) { sum += numbers[k]; });
        ++view.count;
    }
}

/// Returns whether a view's tracks tell where its camera is: COLMAP's own poses fit them best.
bool CameraRefinement::has_tracks(std::size_t view) const {
    return scene_.train[view].observations.size() >= kFewestTracks;
}

/// Takes a step of all cameras that have gradients.
void CameraRefinement::move(double rate) {
    struct LensSum {
        Eigen::Vector4d gradient = Eigen::Vector4d::Zero();
        double tracked = 0, count = 0;
    };
    std::vector<LensSum> sums(lenses_.size());
    for (std::size_t k = 0; k < views_.size(); ++k) {
        LearnedView& view = views_[k];
        if (view.count == 0) continue;
        Camera& camera = scene_.train[k].camera;
        const double mean = 1 / view.count;
        const CameraGradient<double>& sum = view.sum;
        LensSum& lens = sums[view.lens];
        lens.gradient +=
            mean * Eigen::Vector4d(sum.fx * camera.fx + sum.fy * camera.fy, sum.cx, sum.cy, sum.distortion);
        lens.tracked += has_tracks(k);
        ++lens.count;
        const double pull = has_tracks(k) ? kPullWithTracks : kPullWithoutTracks;
        view.pose.step(camera, mean * pose_gradient(camera, view.sum), rate, pull, largest_correction(camera));
        view.sum = {}, view.count = 0;
    }
    for (std::size_t k = 0; k < lenses_.size(); ++k) {
        LearnedLens& lens = lenses_[k];
        if (sums[k].count == 0 || lens.pixel[0] == 0) continue;
        const Eigen::Vector4d gradient = sums[k].gradient.cwiseProduct(lens.pixel) / sums[k].count;
        if (!gradient.allFinite()) continue;
        const int size = lens.pixel[3] == 0 ? 3 : 4;
        Eigen::Vector4d direction;
        const double root = adam_direction(lens.moments, size, gradient.data(), direction.data());
        if (root == 0) continue;
        const double of_lens = rate * std::min(1.0, lens.num_views / kViewsOfLens);
        const double tracked = sums[k].tracked / sums[k].count, most = largest_correction(lens.given);
        for (int i = 0; i < size; ++i) {
            const double way = (lens.now[i] - lens.start[i]) / lens.pixel[i] - of_lens * direction[i];
            const double left =
                way * share_after_pull(way, std::max(tracked * kPullWithTracks, kPullOfLens[i]), of_lens, root);
            const double bound = i == 0 ? kMostLogFocal / lens.pixel[0] : most;
            lens.now[i] = lens.start[i] + lens.pixel[i] * std::clamp(left, -bound, bound);
        }
    }
    set_lenses();
    take_back_common_part();
    take_back_drift();
}

/// Gives the cameras of the scene the learned lenses, those of test images with the same lens, too.
void CameraRefinement::set_lenses() {
    const auto set = [](Camera& camera, const LearnedLens& lens) {
        static_cast<LensCamera&>(camera) = lens.learned();
        camera.range = lens.range;
    };
    for (LearnedLens& lens : lenses_) lens.update_range();
    for (std::size_t k = 0; k < views_.size(); ++k) set(scene_.train[k].camera, lenses_[views_[k].lens]);
    for (View& view : scene_.test) {
        const LensCamera given = view.given ? *view.given : view.camera;
        for (const LearnedLens& lens : lenses_) {
            if (lens.given != given) continue;
            if (!view.given) view.given = std::make_shared<const Camera>(view.camera);
            set(view.camera, lens);
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
    using Matrix64 = Eigen::Matrix<double, 6, 4>;
    for (std::size_t l = 0; l < lenses_.size(); ++l) {
        const double before = error_of_tracks(l);
        if (before == 0) continue;
        const LearnedLens lens_before = lenses_[l];
        std::vector<Camera> cameras_before;
        for (const View& view : scene_.train) cameras_before.push_back(view.camera);
        for (int round = 0; round < kRounds; ++round) {
            // The poses are eliminated from the normal equations.
            Eigen::Matrix4d of_lens = Eigen::Matrix4d::Zero();
            Eigen::Vector4d toward_lens = Eigen::Vector4d::Zero();
            std::vector<std::pair<Vector6d, Matrix64>> of_poses(views_.size(), {Vector6d::Zero(), Matrix64::Zero()});
            for (std::size_t k = 0; k < views_.size(); ++k) {
                const auto& observations = scene_.train[k].observations;
                if (views_[k].lens != l || !has_tracks(k)) continue;
                TrackError error = track_error(scene_.train[k].camera, observations);
                error.hessian.diagonal() *= 1 + kDamping;
                const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> pose(error.hessian.topLeftCorner<6, 6>());
                const Matrix64 mixed = error.hessian.topRightCorner<6, 4>();
                of_poses[k] = {pose.solve(error.gradient.head<6>()), pose.solve(mixed)};
                of_lens += error.hessian.bottomRightCorner<4, 4>() - mixed.transpose() * of_poses[k].second;
                toward_lens += error.gradient.tail<4>() - mixed.transpose() * of_poses[k].first;
            }
            // In pixels, so that what is not learned is a row and a column of zeros.
            const Eigen::Vector4d& pixel = lenses_[l].pixel;
            const Eigen::Matrix4d in_pixels = pixel.asDiagonal() * of_lens * pixel.asDiagonal();
            const Eigen::Vector4d by_lens =
                -pixel.cwiseProduct(in_pixels.ldlt().solve(pixel.cwiseProduct(toward_lens)));
            if (!by_lens.allFinite()) break;
            lenses_[l].now += by_lens;
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
    for (const LearnedLens& lens : lenses_) out.focal = std::max(out.focal, std::abs(std::expm1(lens.now[0])));
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
        auto& row = state.lenses.emplace_back(lens.now.begin(), lens.now.end());
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
        for (double& change : lenses_[k].now) change = *at++;
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
