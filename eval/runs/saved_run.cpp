// SPDX-License-Identifier: Apache-2.0
// Loads the model of a run folder onto a backend.
#include "eval/runs/saved_run.h"

#include <fmt/format.h>

#include "appearance/model_info.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "kernels/splat/smoothing.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/export/pack_scene.h"
#include "lib/io/ply_file.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/checkpoint.h"
#include "lib/model/model_file.h"
#include "lib/model/ply.h"
#include "lib/model/ppisp_json.h"
#include "lib/model/run_folder.h"
#include "lib/model/whole_model.h"
#include "lib/scene/scene.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

SavedModel from_ply(const RunFolder& folder, std::int64_t iteration) {
    SavedModel model;
    model.iteration = iteration;
    model.state = read_ply(folder.point_cloud(iteration), &model.frame);
    return model;
}

SavedModel from_checkpoint(const fs::path& path) {
    Checkpoint checkpoint = read_checkpoint(path);
    merge_smoothing(checkpoint.state);
    return {.state = std::move(checkpoint.state), .iteration = checkpoint.iteration, .frame = checkpoint.frame};
}

SavedModel read_gaussians(const RunFolder& folder, std::optional<std::int64_t> iteration) {
    if (iteration) {
        if (path_exists(folder.point_cloud(*iteration))) return from_ply(folder, *iteration);
        if (path_exists(folder.checkpoint(*iteration))) return from_checkpoint(folder.checkpoint(*iteration));
        throw DataError(fmt::format("{}: neither {} nor {} exists; a training saves it with --save-iterations {}",
                                    folder.root.string(), folder.point_cloud(*iteration).string(),
                                    folder.checkpoint(*iteration).string(), *iteration));
    }
    if (path_exists(folder.root / "point_cloud")) return from_ply(folder, latest_point_cloud(folder.root));
    return from_checkpoint(latest_checkpoint(folder.root));
}

}  // namespace

TrainOptions saved_options(const fs::path& run_folder, const RunChanges& instead) {
    const bool bare = is_point_cloud(run_folder);
    if (bare && !instead.point_cloud)
        throw UsageError(fmt::format("'{}' is no run folder, which is needed here", run_folder.string()));
    // Checks the kind of file first, so that a wrong file is not reported as a missing scene.
    require_model_file(run_folder);
    if (bare) PlyReader{run_folder};
    TrainOptions options = bare ? *instead.point_cloud : load_run_options(run_folder);
    options.model = run_folder.string();  // the folder may have been moved
    if (!instead.source.empty()) options.source = instead.source;
    if (instead.device) options.device = *instead.device;
    if (instead.lens) {
        if (!bare && !instead.other_scene && *instead.lens != options.lens)
            throw UsageError(
                fmt::format("--lens: '{}' is seen as it was trained; gsapp eval scores it through another lens",
                            run_folder.string()));
        options.lens = *instead.lens;
    }
    if (!options.source.empty()) return options;
    if (!bare)
        throw DataError(fmt::format("{}: no 'source', so the scene of the run is not known",
                                    RunFolder{run_folder}.config().string()));
    if (instead.needs_scene)
        throw UsageError(
            fmt::format("'{}' is a point cloud without a run, which has no views: name their scene with --source SCENE",
                        run_folder.string()));
    return options;
}

bool is_point_cloud(const fs::path& path) {
    std::error_code error;  // inaccessible paths are reported by the later read
    const fs::file_status status = fs::status(path, error);
    if (fs::is_directory(status)) return false;
    return path.extension() == ".ply" || fs::exists(status);
}

bool holds_model(const fs::path& run_folder) {
    if (run_folder.empty()) return false;
    if (is_point_cloud(run_folder)) return true;
    return path_exists(run_folder / "point_cloud") || path_exists(run_folder / "checkpoints");
}

SavedModel read_saved_model(const fs::path& run_folder, std::optional<std::int64_t> iteration) {
    if (is_point_cloud(run_folder)) {
        if (iteration)
            throw UsageError(fmt::format("--iteration {}: '{}' is one point cloud, not a run with several", *iteration,
                                         run_folder.string()));
        SavedModel model;
        model.state = read_ply(run_folder, &model.frame);
        return model;
    }
    const RunFolder folder{run_folder};
    SavedModel model = read_gaussians(folder, iteration);
    if (path_exists(folder.ppisp())) {
        PpispFile file = read_ppisp_json(folder.ppisp());
        if (file.iteration != model.iteration)
            log_warning("{} is of iteration {}, the model of {}", folder.ppisp().string(), file.iteration,
                        model.iteration);
        model.correction.exif = file.exif, model.correction.mean_exif = file.mean_exif;
        model.state.ppisp = std::move(file.state);
    }
    model.correction.mode = best_correction(model.state.ppisp);
    return model;
}

Scene load_scene_of(SavedModel& model, const TrainOptions& options, const RunChanges& changes) {
    const LoadRules rules{.frame = model.frame, .scores = changes.scores};
    const bool may_differ =
        is_point_cloud(options.model) || (changes.other_scene && (!changes.source.empty() || changes.lens));
    Scene scene = may_differ ? load_scene(options, rules) : load_run_scene(options.model, options, rules);
    if (!model.frame) {
        bring_into_frame(model.state, scene.frame);
        model.frame = scene.frame;
    }
    return scene;
}

void set_appearance(TrainOptions& options, const AppearanceSpec& appearance) {
    options.appearance = appearance.model;
    options.color_activation = appearance.activation;
    if (const std::string& degree = appearance_model(appearance.model).degree_option; !degree.empty())
        options.model_options.at(degree) = appearance.max_degree;
}

SavedRun open_saved_run(const fs::path& run_folder, std::optional<std::int64_t> iteration, const RunChanges& instead) {
    SavedRun run;
    run.folder = run_folder;
    run.options = saved_options(run_folder, instead);
    SavedModel model = read_saved_model(run_folder, iteration);
    if (is_point_cloud(run_folder)) set_appearance(run.options, model.state.appearance);
    if (run.options.source.empty()) {
        run.scene.frame = model.frame.value_or(Frame{});
    } else {
        run.scene = load_scene_of(model, run.options, instead);
        if (instead.other_scene && (!instead.source.empty() || instead.lens) && !is_point_cloud(run_folder)) {
            const bool other_lens = instead.lens && *instead.lens != load_run_options(run_folder).lens;
            run.is_other_scene = other_lens || is_other_scene(run_folder, run.options, run.scene);
            if (!run.is_other_scene) require_run_scene(run_folder, run.options, run.scene);
        }
    }
    run.iteration = model.iteration;
    run.correction = model.correction;
    run.backend = make_backend(run.options.device, model.state.appearance, engine_options(run.options), instead.group);
    log_device(run.options.device, *run.backend);
    run.backend->upload(model.state);
    run.background = run.options.background.color;
    return run;
}

nlohmann::ordered_json read_appearance_choice(const fs::path& run_folder) {
    const fs::path path = RunFolder{run_folder}.appearance_choice();
    if (!path_exists(path)) return nullptr;
    auto json = try_parse_ordered_json(read_input(path));
    if (!json.is_object()) throw DataError(fmt::format("{}: not a JSON object", path.string()));
    return json;
}

void add_run_facts(RunResult& result, const TrainOptions& options, const Scene& scene, const Backend& backend) {
    result.dataset = dataset_name(options.source);
    result.scene = scene_name(options.source);
    result.model = options.appearance;
    const AppearanceSpec appearance = appearance_spec(options);
    if (!appearance_model(options.appearance).degree_option.empty())
        result.model += fmt::format(" (degree {})", appearance.max_degree);
    const bool bare = is_point_cloud(options.model);
    if (!bare) result.appearance_choice = read_appearance_choice(options.model);
    if (!result.appearance_choice.is_null()) result.model += " by auto";
    if (!bare) result.strategy = word(options.strategy) + (options.speedy_splat ? " + speedy-splat" : "");
    result.frame = frame_json(scene.frame);
    result.num_gaussians = backend.count();
    const int residual = group_width(Group::kResidual, appearance);
    const double share =
        residual > 0 && backend.count() > 0 ? double(backend.num_residuals()) / double(backend.count()) : 1;
    if (share < 1) result.residual_share = share;
    result.bytes_per_gaussian =
        std::llround(double(sizeof(float)) * (group_width(Group::kBase, appearance) + share * residual));
    result.ply_bytes_per_gaussian = ply_bytes_per_gaussian(appearance);
    if (appearance_model(appearance.model).packing) {
        const PackedScene packed = packed_sample(appearance);
        const int without = packed.bytes_per_gaussian(false);
        result.web_bytes_per_gaussian = std::llround(without + share * (packed.bytes_per_gaussian() - without));
    }
}

}  // namespace gs
