// SPDX-License-Identifier: Apache-2.0
// The viewer's page for a run folder or a point cloud that was not exported.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "apps/gsapp/live/live_page.h"
#include "lib/io/temporary.h"

namespace gs {

/// Serves a run with its curves and photographs, or the Gaussians of a .ply file alone. A run that another program is
/// still training is followed: what it saves is shown.
class SavedPage {
  public:
    /// `target` is a run folder or a .ply file, and `source` the place of the run's scene if it is not where the run
    /// has it. Throws DataError for a file that cannot be read and for a run without any model that does not train, and
    /// what LivePage throws. A scene that cannot be loaded any more, or is not the run's, is a warning: its photographs
    /// are missing then.
    SavedPage(std::filesystem::path target, const std::string& source, std::optional<int> port);

    std::string address() const { return page_->address(); }
    /// Returns after Ctrl-C.
    void run();

  private:
    void show_newest();

    const std::filesystem::path target_;
    const bool is_run_;
    std::vector<View> views_;
    bool are_training_views_ = false;
    Vec3<float> background_{0, 0, 0};
    std::optional<Frame> frame_;  ///< of the loaded scene
    std::string scene_;
    WorkFolder folder_;
    std::string shown_;  ///< the file, and when it was written
    std::filesystem::path snapshot_;
    int num_snapshots_ = 0;
    std::optional<LivePage> page_;
};

}  // namespace gs
