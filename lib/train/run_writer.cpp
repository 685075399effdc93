// SPDX-License-Identifier: Apache-2.0
// Writes the state of a run to the files of its folder.
#include "lib/train/run_writer.h"

#include <algorithm>

#include "kernels/base/clock.h"
#include "lib/core/options.h"
#include "lib/core/run_config.h"
#include "lib/io/atomic_file.h"
#include "lib/io/image.h"
#include "lib/io/temporary.h"
#include "lib/model/cameras_json.h"
#include "lib/model/checkpoint.h"
#include "lib/model/ply.h"
#include "lib/model/refined_scene.h"
#include "lib/scene/camera_params.h"
#include "lib/train/training_schedule.h"

namespace gs {
namespace {

/// The number of Gaussians in the file that is timed to predict the time of larger files.
constexpr std::int64_t kTimedRows = 300000;

/// Repeats the rows of a model without moments until there are `count`.
void repeat_rows(Gaussians& model, std::int64_t count) {
    for (auto& group : model.groups) {
        const std::size_t rows = group.param.size();
        group.param.resize(std::size_t(count) * std::size_t(group.width));
        for (std::size_t k = rows; k < group.param.size(); ++k) group.param[k] = group.param[k - rows];
    }
    model.count = count;
}

}  // namespace

RunWriter::RunWriter(RunFolder folder, std::shared_ptr<const RunLock> lock, std::string cameras,
                     const TrainOptions& options, const Scene& scene, const Photometric& photometric,
                     TensorBoard* tensorboard)
    : folder_(std::move(folder)),
      lock_(std::move(lock)),
      cameras_(cameras.empty() ? cameras_json(scene) : std::move(cameras)),
      config_(run_config(options)),
      cfg_args_(cfg_args(folder_, options)),
      seed_(options.seed),
      cap_(options.cap_max),
      scene_(scene),
      photometric_(photometric),
      tensorboard_(tensorboard) {}

void RunWriter::write_config() const {
    check_folder();
    write_text_atomic(folder_.config(), config_);
    write_text_atomic(folder_.cfg_args(), cfg_args_);
    write_text_atomic(folder_.cameras(), cameras_);
}

void RunWriter::write_refined_cameras(const std::vector<double>& corrections) const {
    check_folder();
    write_text_atomic(folder_.cameras(), with_refined_cameras(cameras_, scene_, corrections));
    write_refined_scene(folder_.refined_scene(), scene_);
}

void RunWriter::write_start(const PointCloud& first_points) const {
    write_config();
    write_input_points(folder_, first_points, scene_.frame);
}

void RunWriter::write_checkpoint(Checkpoint checkpoint) const {
    check_folder();
    checkpoint.seed = seed_, checkpoint.options_yaml = config_;
    checkpoint.test_views = view_digest(scene_.test), checkpoint.frame = scene_.frame;
    gs::write_checkpoint(folder_.checkpoint(checkpoint.iteration), checkpoint);
    remove_automatic_checkpoints(folder_, checkpoint.iteration);
}

void RunWriter::write_point_cloud(Backend& backend, std::int64_t iteration) const {
    check_folder();
    save_points(folder_.point_cloud(iteration), backend.download(false), iteration);
    write_ppisp(backend, iteration);
}

void RunWriter::save_points(const std::filesystem::path& path, const Gaussians& gaussians,
                            std::int64_t iteration) const {
    PlyOptions ply;
    ply.iteration = iteration;
    ply.frame = scene_.frame;
    write_ply(path, gaussians, ply);
}

double RunWriter::seconds_per_gaussian(Backend& backend) const {
    check_folder();
    const double start = seconds_now();
    Gaussians model = backend.download(false);
    // A scene may begin with a few points, whose file does not predict the time of a large file. Repeating the rows
    // takes about as long as reading that many back.
    repeat_rows(model, std::max(model.count, std::min(cap_, kTimedRows)));
    const WorkFolder work(folder_.root / "timing");
    save_points(work.path() / "points.ply", model, 0);
    return std::max(0.0, seconds_now() - start - kSavingOverhead) / double(model.count);
}

Image RunWriter::preview(Backend& backend, const Vec3<float>& background) const {
    const View& view = scene_.test.empty() ? scene_.train.front() : scene_.test.front();
    RenderRequest request;
    request.camera = camera_params(view.camera);
    request.background = background;
    request.isp =
        photometric_.active() ? IspView{.mode = IspMode::kFrame, .camera = std::max(0, view.camera_id)} : IspView{};
    RenderedImage rendered;
    backend.render(request, rendered);
    Image image{rendered.width, rendered.height, 3, {}, {}};
    const std::size_t pixels = rendered.alpha.size();
    image.u8.resize(3 * pixels);
    for (std::size_t i = 0; i < pixels; ++i)
        for (std::size_t c = 0; c < 3; ++c) image.u8[3 * i + c] = to_8_bits(rendered.rgb[c * pixels + i]);
    return image;
}

void RunWriter::write_preview(Backend& backend, const Vec3<float>& background, std::int64_t iteration) const {
    check_folder();
    const Image image = preview(backend, background);
    write_image(folder_.preview(iteration), image);
    if (tensorboard_) tensorboard_->add_picture(iteration, "preview", image);
}

void RunWriter::show_preview(Backend& backend, const Vec3<float>& background, std::int64_t iteration) const {
    if (tensorboard_) tensorboard_->add_picture(iteration, "preview", preview(backend, background));
}

}  // namespace gs
