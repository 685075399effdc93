// SPDX-License-Identifier: Apache-2.0
// The viewer's page for a model that may still be training: what it is told, the model and the curves that it shows,
// and what its buttons ask for.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "kernels/base/vec.h"
#include "kernels/state/gaussian_state.h"
#include "lib/export/file_server.h"
#include "lib/scene/scene.h"

namespace gs {

/// Values by iteration.
struct Curve {
    std::vector<std::int64_t> iterations;
    std::vector<double> values;

    void add(std::int64_t iteration, double value) {
        iterations.push_back(iteration);
        values.push_back(value);
    }
    /// Returns {"iterations": [...], "values": [...]} with at most about `most` points, the last among them. Values
    /// that are not finite are null.
    nlohmann::ordered_json json(std::size_t most) const;
};

/// Follows stats/train.jsonl while it grows.
class CourseLog {
  public:
    explicit CourseLog(std::filesystem::path file) : file_(std::move(file)) {}

    /// Reads the lines that have come since the last call. A file that replaced the one before is read from its
    /// beginning. Lines that are no JSON object with an iteration are skipped.
    void update();

    const Curve& loss() const { return loss_; }
    /// The PSNR of held-out views, dB: of test views, or of those for --target-psnr.
    const Curve& psnr() const { return psnr_; }
    /// What the last line of the training said; 0 before the first.
    std::int64_t iteration() const { return iteration_; }
    std::int64_t num_gaussians() const { return num_gaussians_; }
    double train_seconds() const { return train_seconds_; }

  private:
    void read_line(const std::string& line);

    std::filesystem::path file_;
    std::uintmax_t read_ = 0;  ///< bytes
    std::uintmax_t inode_ = 0;
    Curve loss_, psnr_;
    std::int64_t iteration_ = 0, num_gaussians_ = 0;
    double train_seconds_ = 0;
};

/// What a snapshot says beside the model.
struct SnapshotFacts {
    std::string scene;
    std::int64_t iteration = 0;
    Vec3<float> background{0, 0, 0};
    Frame frame;
    std::vector<View> views;  ///< views that the page offers
    bool are_training_views = false;
};

/// Packs the visible Gaussians and writes them as .ngsplat. A photometric correction has neutral exposure and colour in
/// every view. Throws UsageError for a model that cannot be packed, and DataError for parameters that are not finite
/// and if the file cannot be written.
void write_snapshot(const std::filesystem::path& file, const Gaussians& model, const SnapshotFacts& facts);

/// What stays the same while a page is served.
struct LivePageFacts {
    std::string scene, appearance, run;  ///< names to show
    std::filesystem::path log;           ///< stats/train.jsonl; may be missing
    std::vector<View> views;             ///< photographs of the views that the page offers
    Vec3<float> background{0, 0, 0};     ///< behind photographs with transparency
    bool controls = false;               ///< whether the buttons do something
};

/// What the buttons asked for and nobody has done yet.
struct WatcherRequests {
    bool pause = false, save = false, stop = false;
};

/// Serves the built viewer, the latest snapshot, the course of the training and photographs on 127.0.0.1
/// (docs/formats.md#the-live-page). All members may be called from any thread.
class LivePage {
  public:
    /// Begins to serve; a port of 0 is any free one, none at all is 8000 or any free one. Throws DataError when the
    /// port is taken or the viewer is not built.
    LivePage(LivePageFacts facts, std::optional<int> port);
    ~LivePage();

    /// Returns the address to open. Whoever has it can use the buttons.
    std::string address() const;

    /// Returns true while somebody looks: a page has asked within the last few seconds.
    bool watched() const;

    /// Replaces the fields of the same names in what pages are told.
    void tell(const nlohmann::ordered_json& fields);
    /// Shows another snapshot, a file that stays until the next one is shown.
    void show(const std::filesystem::path& snapshot, std::int64_t iteration);
    /// Adds a point to the curve of PSNR; `what` names what was measured.
    void add_psnr(std::int64_t iteration, double psnr, const std::string& what);

    WatcherRequests requests() const;
    /// Forgets a request to save, which is done.
    void saved();

    /// Waits until a watching page has the last state and snapshot, at most `seconds`.
    void linger(double seconds);

  private:
    std::optional<WebAnswer> answer(const WebRequest& request);
    WebAnswer status();
    WebAnswer photograph(const std::string& name);
    WebAnswer control(const WebRequest& request);

    const LivePageFacts facts_;
    const std::string token_, id_;
    mutable std::mutex mutex_;
    nlohmann::ordered_json state_ = nlohmann::ordered_json::object();
    CourseLog course_;
    Curve psnr_;
    std::string psnr_of_;
    std::filesystem::path snapshot_;
    std::int64_t version_ = 0, snapshot_iteration_ = 0, fetched_ = 0;
    std::vector<std::weak_ptr<void>> transfers_;  ///< snapshots on their way
    WatcherRequests wishes_;
    std::atomic<double> looked_ = -1e9;  ///< when a page last asked
    bool told_last_ = false;             ///< a page has asked since the last change of the state
    FileServer server_;
    std::thread thread_;
};

}  // namespace gs
