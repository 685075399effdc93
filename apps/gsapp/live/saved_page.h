// SPDX-License-Identifier: Apache-2.0
// The viewer's page for a run folder or a point cloud that has not been exported.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "apps/gsapp/live/live_page.h"
#include "lib/io/temporary.h"

namespace gs {

/// Serves a run with its curves and photographs, or only the Gaussians of a .ply file. If another program is still
/// training the run, newly saved models are shown as they appear.
class SavedPage {
  public:
    /// `target` is a run folder or a .ply file, and `source` the path of the run's scene if it has moved. Throws
    /// DataError for a file that cannot be read and for a run with neither a saved model nor a training log, and the
    /// errors of LivePage. If the scene cannot be loaded any more, or is not the run's own, logs a warning and shows no
    /// photographs.
    SavedPage(std::filesystem::path target, const std::string& source, std::optional<int> port);

    std::string address() const { return page_->address(); }
    /// Serves the page until Ctrl-C.
    void run();

  private:
    void show_newest();

    const std::filesystem::path target_;
    const bool is_run_;
    std::vector<View> views_;
    bool are_training_views_ = false;
    Vec3<float> background_{0, 0, 0};
    std::optional<Frame> frame_;  ///< frame of the loaded scene
    std::string scene_;
    WorkFolder folder_;
    std::string shown_;  ///< the shown file and its modification time
    std::filesystem::path snapshot_;
    int num_snapshots_ = 0;
    std::optional<LivePage> page_;
};

}  // namespace gs
