// SPDX-License-Identifier: Apache-2.0
// The result of a run, and the list of its fields, from which results.json, the entries of suite.json and
// tradeoff.json, and the columns of tables are built.
#pragma once

#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "eval/bench/frame_times.h"
#include "eval/metrics/metrics.h"

namespace gs {

/// The scores of one view.
struct ViewScore {
    std::string name;  ///< name of the photograph
    double psnr = 0;   ///< dB; infinity for identical images
    double ssim = 0;
    double render_seconds = 0;
    std::optional<double> residual_mean = {};        ///< mean_value of the residual image; set if decomposed
    std::map<std::string, MetricScore> scores = {};  ///< scores of other metrics by MetricInfo::key
};

/// The scores and costs of a run at one iteration. Unknown values are empty.
struct RunResult {
    std::filesystem::path folder;  ///< folder of the run
    std::string run;               ///< name of the run: its folder's name
    std::int64_t iteration = 0;

    double psnr = 0, ssim = 0;                  ///< means over the test views; psnr in dB, may be infinite
    std::map<std::string, MetricScore> scores;  ///< means of other metrics by MetricInfo::key, or reasons why missing
    /// Scores with test cameras that were aligned to the model (lib/train/align_cameras.h), and the median correction
    /// in pixels
    std::optional<double> aligned_psnr, aligned_ssim, aligned_pixels;
    std::optional<double> residual_mean;  ///< mean over the views; set if decomposed
    std::vector<ViewScore> views;         ///< scores of the views; not read from files
    nlohmann::ordered_json protocol;      ///< how the scores were computed: `protocol` of results.json

    std::optional<double> train_seconds;       ///< training time, summed over all parts of the run
    std::optional<double> controller_seconds;  ///< training time of the controllers, not included in train_seconds
    std::optional<double> frame_seconds;       ///< mean frame time at the views' size, without the copy to the host
    std::optional<double> render_seconds;      ///< rendering time summed over the views, with the copy to the host
    std::optional<FrameTimes> frame_times;     ///< result of `gsapp bench frames`
    std::optional<std::int64_t> peak_device_bytes;  ///< peak GPU memory held during training

    std::optional<std::string> photometric;     ///< photometric decision of --ppisp auto
    std::optional<std::string> refine_cameras;  ///< decision of --refine-cameras auto
    nlohmann::ordered_json appearance_choice;   ///< auto.json of the run; null if the model was named
    nlohmann::ordered_json plan;                ///< plan of a run with constraints; null without constraints

    std::string dataset;                                 ///< name of the dataset; results are averaged over its scenes
    std::string scene;                                   ///< name of the scene
    std::string model;                                   ///< appearance model, e.g. "sh (degree 3)"
    std::string strategy;                                ///< densification strategy
    nlohmann::ordered_json frame;                        ///< frame_json of the frame that the model was trained in
    std::optional<std::int64_t> num_gaussians;           ///< number of Gaussians
    std::optional<double> residual_share;                ///< share of Gaussians with a residual; empty if all have one
    std::optional<std::int64_t> bytes_per_gaussian;      ///< mean size of base and residual parameters, as trained
    std::optional<std::int64_t> ply_bytes_per_gaussian;  ///< size of a Gaussian in point_cloud.ply, all parameters
    std::optional<std::int64_t> web_bytes_per_gaussian;  ///< mean size of a Gaussian in scene.ngsplat, all parameters
    std::optional<std::int64_t> bytes;                   ///< size of the model's file, if jobs are compared by size

    std::uint64_t seed = 0;                       ///< seed in config.yaml
    std::map<std::string, std::string> training;  ///< training_options of config.yaml; empty without that file

    /// Returns the name of the protocol, one of protocols(). Empty if the result has no protocol.
    std::string protocol_name() const;
    /// Returns the protocol line printed below tables; scores with different lines are not comparable. Empty if the
    /// result has no protocol.
    std::string protocol_line() const;
    /// Returns the correction_name of the photometric correction. Empty if the result has none.
    std::string correction() const;
    /// Returns frames per second, the inverse of frame_seconds.
    std::optional<double> fps() const;
};

/// A field of RunResult that is stored in files.
struct ResultField {
    /// Key in JSON.
    const char* name;
    /// Section in results.json. The value is at [section]["ours_N"][name]; at ["ours_N"][name] if the section is empty;
    /// and at [name]["ours_N"] if the section equals the name. Null: results.json does not have the field.
    const char* section;
    /// Member of RunResult. Only fields of type double are required in the file.
    std::variant<double RunResult::*, std::string RunResult::*, std::optional<double> RunResult::*,
                 std::optional<std::int64_t> RunResult::*, std::optional<std::string> RunResult::*,
                 std::optional<FrameTimes> RunResult::*, nlohmann::ordered_json RunResult::*>
        member;

    bool required() const { return std::holds_alternative<double RunResult::*>(member); }
};

/// Returns all fields, in the order of results.json.
const std::vector<ResultField>& result_fields();
/// Returns the field with this name, which must exist.
const ResultField& result_field(const std::string& name);

/// Returns the value of a numeric field; empty if the result lacks it or the field is not a number.
std::optional<double> field_number(const RunResult& result, const ResultField& field);
/// Returns the value as JSON, with null for infinity; empty if the result lacks it.
std::optional<nlohmann::ordered_json> field_json(const RunResult& result, const ResultField& field);
/// Reads the value from JSON. Returns false, and leaves the field unchanged, if the value has another type.
bool read_field(RunResult& result, const ResultField& field, const nlohmann::ordered_json& value);

/// Returns the named fields that the result has, as one JSON object.
nlohmann::ordered_json result_json(const RunResult& result, std::initializer_list<const char*> names);

}  // namespace gs
