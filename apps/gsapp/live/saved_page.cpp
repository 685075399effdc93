// SPDX-License-Identifier: Apache-2.0
// Packs the saved models of a run, each time that a newer one appears.
#include "apps/gsapp/live/saved_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <system_error>
#include <thread>

#include "apps/gsapp/live/live_page.h"
#include "eval/runs/run_scene.h"
#include "eval/runs/saved_run.h"
#include "eval/runs/shown_views.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/model/run_folder.h"
#include "lib/model/whole_model.h"
#include "lib/scene/resized.h"
#include "lib/scene/scene.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kLook(50);
constexpr int kLooksBetweenReads = 40;  ///< checks for a newer model every two seconds

/// Returns the file of a saved model and its modification time as text, for comparison.
std::string identity_of(const fs::path& file) {
    std::error_code ignored;
    return fmt::format("{} {}", file.string(), fs::last_write_time(file, ignored).time_since_epoch().count());
}

}  // namespace

SavedPage::SavedPage(fs::path target, const std::string& source, std::optional<int> port)
    : target_(std::move(target)), is_run_(fs::is_directory(target_)), folder_(own_temporary_folder() / "page") {
    LivePageFacts facts;
    if (is_run_) {
        TrainOptions options = load_run_options(target_);
        if (!source.empty()) options.source = source;
        const auto newest = latest_saved(target_);
        if (!newest && !path_exists(RunFolder{target_}.train_log()))
            throw DataError(fmt::format("{}: the run has saved no model", target_.string()));
        scene_ = scene_name(options.source);
        background_ = options.background.color;
        LoadRules rules;
        if (newest) rules.frame = read_saved_model(target_, newest).frame;
        try {
            const Scene loaded = load_run_scene(target_, options, rules);
            views_ = shown_views(loaded);
            are_training_views_ = loaded.test.empty();
            frame_ = loaded.frame;
        } catch (const std::exception& e) {
            log_warning("no photographs are shown: {}", e.what());
        }
        facts.appearance = options.appearance;
        facts.log = RunFolder{target_}.train_log();
    } else {
        scene_ = target_.stem().string();
    }
    facts.scene = scene_;
    facts.run = target_.string();
    facts.views = without_lenses(views_);
    facts.background = background_;
    page_.emplace(facts, port);
    page_->tell({{"state", "saved"}});
    show_newest();
}

void SavedPage::show_newest() {
    const auto iteration = is_run_ ? latest_saved(target_) : std::nullopt;
    if (is_run_ && !iteration) return;
    const RunFolder run{target_};
    fs::path source = target_;
    if (is_run_)
        source = path_exists(run.point_cloud(*iteration)) ? run.point_cloud(*iteration) : run.checkpoint(*iteration);
    const std::string newest = identity_of(source);
    if (newest == shown_) return;
    SavedModel model = read_saved_model(target_, iteration);
    // A model without a frame takes the frame of the photographs' cameras.
    if (!model.frame && frame_) bring_into_frame(model.state, *frame_);
    const Frame frame = model.frame.value_or(frame_.value_or(Frame{}));
    const fs::path file = folder_.path() / fmt::format("{}.ngsplat", ++num_snapshots_);
    write_snapshot(file, model.state, {scene_, model.iteration, background_, frame, views_, are_training_views_});
    page_->show(file, model.iteration);
    page_->tell({{"iteration", model.iteration}, {"num_gaussians", model.state.count}});
    std::error_code ignored;  // a file being sent stays open
    if (!snapshot_.empty()) fs::remove(snapshot_, ignored);
    snapshot_ = file, shown_ = newest;
}

void SavedPage::run() {
    for (int looks = 1; !interrupted(); ++looks) {
        std::this_thread::sleep_for(kLook);
        if (looks % kLooksBetweenReads != 0) continue;
        try {
            show_newest();
        } catch (const std::exception& e) {  // the run may be writing the model, or was removed
            log_debug("{}: {}", target_.string(), e.what());
        }
    }
}

}  // namespace gs
