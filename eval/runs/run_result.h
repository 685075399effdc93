// SPDX-License-Identifier: Apache-2.0
// The result of a run, and the list of its fields: results.json, the entries of suite.json and tradeoff.json, and the
// columns of tables are made of it.
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
    std::optional<double> residual_mean = {};        ///< mean_value of the residual picture, when decomposed
    std::map<std::string, MetricScore> scores = {};  ///< scores of other metrics by MetricInfo::key
};

/// The scores and costs of a run at one iteration. What is not known is empty.
struct RunResult {
    std::filesystem::path folder;  ///< folder of the run
    std::string run;               ///< name of the run: that of its folder
    std::int64_t iteration = 0;

    double psnr = 0, ssim = 0;                  ///< means over the test views; psnr in dB, may be infinite
    std::map<std::string, MetricScore> scores;  ///< means of other metrics by MetricInfo::key, or why there is none
    std::optional<double> residual_mean;        ///< mean over the views, when decomposed
    std::vector<ViewScore> views;               ///< scores of the views; not read from files
    nlohmann::ordered_json protocol;            ///< how the scores were made: `protocol` of results.json

    std::optional<double> train_seconds;       ///< time of training, of all parts of the run
    std::optional<double> controller_seconds;  ///< time of the controllers' training, not in train_seconds
    std::optional<double> frame_seconds;       ///< mean of a frame at the views' size, without the copy to the host
    std::optional<double> render_seconds;      ///< sum over the views, with the copy to the host
    std::optional<FrameTimes> frame_times;     ///< result of `gsapp bench frames`
    std::optional<std::int64_t> peak_device_bytes;  ///< most GPU memory held while training

    std::optional<std::string> photometric;    ///< decision of --ppisp auto
    nlohmann::ordered_json appearance_choice;  ///< auto.json of the run; null if the model was named
    nlohmann::ordered_json plan;               ///< plan of a run with constraints; null without

    std::string dataset;                                 ///< name of the dataset; its scenes are averaged
    std::string scene;                                   ///< name of the scene
    std::string model;                                   ///< appearance model, e.g. "sh (degree 3)"
    std::string strategy;                                ///< strategy of densification
    nlohmann::ordered_json frame;                        ///< frame_json of the frame that the model was trained in
    std::optional<std::int64_t> num_gaussians;           ///< number of Gaussians
    std::optional<double> residual_share;                ///< share of Gaussians with a residual, where not all have one
    std::optional<std::int64_t> bytes_per_gaussian;      ///< mean size of base and residual, as trained
    std::optional<std::int64_t> ply_bytes_per_gaussian;  ///< size of a whole Gaussian in point_cloud.ply
    std::optional<std::int64_t> web_bytes_per_gaussian;  ///< mean size of a whole Gaussian in scene.ngsplat
    std::optional<std::int64_t> bytes;                   ///< size of the model's file, where jobs are compared by it

    std::uint64_t seed = 0;                       ///< seed in config.yaml
    std::map<std::string, std::string> training;  ///< training_options of config.yaml; empty without one

    /// Returns the name of the protocol, one of protocols(). Empty if not stated.
    std::string protocol_name() const;
    /// Returns the line that stands under tables; scores of different ones do not compare. Empty if not stated.
    std::string protocol_line() const;
    /// Returns the photometric correction by correction_name. Empty if not stated.
    std::string correction() const;
    /// Returns frames per second, of frame_seconds.
    std::optional<double> fps() const;
};

/// A field of RunResult that files have.
struct ResultField {
    /// Its key in JSON
    const char* name;
    /// Its place in results.json: [section]["ours_N"][name]; without section ["ours_N"][name], and for a section of
    /// its own name [name]["ours_N"]. Null: results.json does not have it.
    const char* section;
    /// Its place in RunResult. Only a plain double has to be in the file.
    std::variant<double RunResult::*, std::string RunResult::*, std::optional<double> RunResult::*,
                 std::optional<std::int64_t> RunResult::*, std::optional<std::string> RunResult::*,
                 std::optional<FrameTimes> RunResult::*, nlohmann::ordered_json RunResult::*>
        member;

    bool required() const { return std::holds_alternative<double RunResult::*>(member); }
};

/// Returns all fields, in the order of results.json.
const std::vector<ResultField>& result_fields();
/// Returns the field of this name, which must be one.
const ResultField& result_field(const std::string& name);

/// Returns the value of a number; empty if the result lacks it, and for other fields.
std::optional<double> field_number(const RunResult& result, const ResultField& field);
/// Returns the value in JSON, which has null for infinity; empty if the result lacks it.
std::optional<nlohmann::ordered_json> field_json(const RunResult& result, const ResultField& field);
/// Takes the value out of JSON. Returns false, and leaves the field as it is, for a value of another type.
bool read_field(RunResult& result, const ResultField& field, const nlohmann::ordered_json& value);

/// Returns those of the named fields that the result has, as one JSON object.
nlohmann::ordered_json result_json(const RunResult& result, std::initializer_list<const char*> names);

}  // namespace gs
