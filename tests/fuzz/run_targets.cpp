// SPDX-License-Identifier: Apache-2.0
// Readers of a run folder's files.
#include <array>

#include "apps/gsapp/render/camera_path.h"
#include "eval/report/comparison.h"
#include "eval/report/report.h"
#include "eval/runs/results.h"
#include "eval/runs/saved_run.h"
#include "lib/core/options.h"
#include "lib/model/cameras_json.h"
#include "lib/model/run_folder.h"
#include "lib/train/train_log.h"
#include "tests/fuzz/target.h"
#include "tests/scene/scene_fixture.h"

namespace gs::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr const char* kResults = R"json({"ours_7": {"SSIM": 0.5, "PSNR": 20.5, "LPIPS-VGG": 0.25},
"protocol": {"ours_7": {"name": "inria", "line": "a line", "ppisp_eval": "none"}},
"timing": {"ours_7": {"train_seconds": 3.5, "frame_seconds": 0.01}}, "memory": {"ours_7": {"peak_device_bytes": 1000}},
"num_gaussians": {"ours_7": 12}, "not_measured": {"ours_7": {"DISTS": "no weights"}},
"frame_times": {"ours_7": {"protocol": "x", "device": "cpu", "num_views": 2, "frames_per_view": 3, "mean_seconds": 0.1,
"median_seconds": 0.1, "min_seconds": 0.1, "max_seconds": 1}}, "run": {"ours_7": {"dataset": "d", "scene": "s",
"model": "sh (degree 3)", "strategy": "mcmc", "bytes_per_gaussian": 192}}})json";

/// Everything that reads results.json: tables in all forms, and the writer that keeps what is there.
void read_results(const std::string& bytes) {
    put("run/results.json", bytes);
    const RunFolder run{folder() / "run"};
    write_frame_times(run, 8, FrameTimes{"cpu", 1, 1, 1, 1, 1, 1});
    put("run/results.json", bytes);
    const Comparison comparison = compare_runs({gs::read_results(run.root, std::nullopt)});
    for (const TableFormat format :
         {TableFormat::kMarkdown, TableFormat::kCsv, TableFormat::kLatex, TableFormat::kJson})
        format_comparison(comparison, format);
    report_tables(comparison);
    report_frame_times(comparison);
    report_plots(comparison);
}

void read_view_scores(const std::string& bytes) {
    static const RunFolder run = [] {
        const RunFolder made{folder() / "seen"};
        for (int i = 0; i < 2; ++i) {
            write_image(made.render("test", 7, i), test::gradient_image(8, 6));
            write_image(made.ground_truth("test", 7, i), test::gradient_image(8, 6));
        }
        put("seen/results.json", kResults);
        return made;
    }();
    put("seen/per_view.json", bytes);
    report_pictures(compare_runs({gs::read_results(run.root, 7)}), {});
}

void read_options(const std::string& bytes) {
    put("configured/parent.yaml", "iterations: 7\n");
    put("configured/config.yaml", bytes);
    TrainOptions options = load_run_options(folder() / "configured");
    options = resolve(options);
}

std::string cameras() {
    Scene scene;
    scene.train.resize(2);
    for (View& view : scene.train) {
        view.name = "a.png";
        static_cast<LensCamera&>(view.camera) =
            make_lens_camera(CameraModel::kPinhole, 16, 12, std::array{20.0, 20.0, 8.0, 6.0});
    }
    return written("cameras.json", [&](const fs::path& path) { write_cameras_json(path, scene); });
}

}  // namespace

std::vector<Target> run_targets() {
    return {
        {"config.yaml",
         [] {
             TrainOptions options;
             options.source = "builtin:diffuse";
             return std::vector<std::string>{options_to_yaml(options), "parent: parent.yaml\nsource: x\n"};
         },
         read_options},
        {"cameras.json",
         [] {
             return std::vector{cameras(), std::string(R"({"camera_type": "perspective", "render_height": 12,
"render_width": 16, "fps": 24, "seconds": 1, "camera_path": [{"camera_to_world": [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3,
0, 0, 0, 1], "fov": 50, "aspect": 1.33}]})")};
         },
         [](const std::string& bytes) { read_camera_path(put("cameras.json", bytes), {}); }},
        {"scene_of_run.json", [] { return std::vector{cameras()}; },
         [](const std::string& bytes) { read_cameras_json(put("scene_of_run.json", bytes)); }},
        {"results.json",
         [] {
             return std::vector<std::string>{kResults, R"({"ours_30000": {"SSIM": 1, "PSNR": null}})"};
         },
         read_results},
        {"per_view.json",
         [] {
             return std::vector<std::string>{
                 R"({"ours_7": {"SSIM": {"00000.png": 0.5}, "PSNR": {"00000.png": null}},
"image_names": {"ours_7": {"00000.png": "a.png", "00001.png": "b.png"}}})"};
         },
         read_view_scores},
        {"auto.json",
         [] { return std::vector<std::string>{R"({"model": "sh", "lines": ["because"], "seconds": 1.5})"}; },
         [](const std::string& bytes) {
             put("chosen/auto.json", bytes);
             read_appearance_choice(folder() / "chosen");
         }},
        {"train.jsonl",
         [] {
             return std::vector<std::string>{
                 "{\"event\": \"step\", \"iteration\": 100, \"loss\": 0.5}\n{\"event\": \"densify\", \"iteration\": "
                 "200, \"added\": 3}\n{\"event\""};
         },
         [](const std::string& bytes) { TrainLog(put("stats/train.jsonl", bytes), 150, true); }},
    };
}

}  // namespace gs::fuzz
