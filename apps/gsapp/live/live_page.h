// SPDX-License-Identifier: Apache-2.0
// The viewer's page for a model that may still be training: its status fields, the model and curves that it shows, and
// the requests from its buttons.
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
    /// Returns {"iterations": [...], "values": [...]} with at most about `most` points, including the last. Values that
    /// are not finite become null.
    nlohmann::ordered_json json(std::size_t most) const;
};

/// Reads stats/train.jsonl while it grows.
class CourseLog {
  public:
    explicit CourseLog(std::filesystem::path file) : file_(std::move(file)) {}

    /// Reads the lines added since the last call. A file that replaced the previous one is read from its start. Lines
    /// that are not JSON objects with an iteration are skipped.
    void update();

    const Curve& loss() const { return loss_; }
    /// Returns the PSNR of held-out views, dB: of test views, or of the views for --target-psnr.
    const Curve& psnr() const { return psnr_; }
    /// Returns the iteration of the log's last line; 0 before the first line.
    std::int64_t iteration() const { return iteration_; }
    std::int64_t num_gaussians() const { return num_gaussians_; }
    double train_seconds() const { return train_seconds_; }

  private:
    void read_line(const std::string& line);

    std::filesystem::path file_;
    std::uintmax_t read_ = 0;  ///< bytes read so far
    std::uintmax_t inode_ = 0;
    Curve loss_, psnr_;
    std::int64_t iteration_ = 0, num_gaussians_ = 0;
    double train_seconds_ = 0;
};

/// Metadata of a snapshot.
struct SnapshotFacts {
    std::string scene;
    std::int64_t iteration = 0;
    Vec3<float> background{0, 0, 0};
    Frame frame;
    std::vector<View> views;  ///< views listed on the page
    bool are_training_views = false;
};

/// Packs the visible Gaussians and writes them as .ngsplat. A photometric correction has neutral exposure and colour in
/// every view. Throws UsageError for a model that cannot be packed, and DataError for parameters that are not finite
/// and if the file cannot be written.
void write_snapshot(const std::filesystem::path& file, const Gaussians& model, const SnapshotFacts& facts);

/// Constant settings of a served page.
struct LivePageFacts {
    std::string scene, appearance, run;  ///< displayed names
    std::filesystem::path log;           ///< path of stats/train.jsonl, which may be missing
    std::vector<View> views;             ///< views listed on the page, with their photographs
    Vec3<float> background{0, 0, 0};     ///< colour behind transparent photographs
    bool controls = false;               ///< whether the buttons are enabled
};

/// Pending requests from the buttons.
struct WatcherRequests {
    bool pause = false, save = false, stop = false;
};

/// Serves the built viewer, the latest snapshot, the training curves and photographs on 127.0.0.1
/// (docs/formats.md#the-live-page). All members may be called from any thread.
class LivePage {
  public:
    /// Starts to serve; port 0 means any free port, and an empty port means 8000 or any free one. Throws DataError if
    /// the port is in use or the viewer is not built.
    LivePage(LivePageFacts facts, std::optional<int> port);
    ~LivePage();

    /// Returns the address to open. Anyone with this address can use the buttons.
    std::string address() const;

    /// Returns whether a page has requested the status within the last few seconds.
    bool watched() const;

    /// Sets status fields, replacing fields of the same names.
    void tell(const nlohmann::ordered_json& fields);
    /// Shows another snapshot; its file must exist until the next one is shown.
    void show(const std::filesystem::path& snapshot, std::int64_t iteration);
    /// Adds a point to the PSNR curve; `what` names the measured views.
    void add_psnr(std::int64_t iteration, double psnr, const std::string& what);

    WatcherRequests requests() const;
    /// Clears the request to save after it has been carried out.
    void saved();

    /// Waits until a watching page has the last status and snapshot, at most `seconds`.
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
    std::vector<std::weak_ptr<void>> transfers_;  ///< snapshots being transferred
    WatcherRequests requests_;
    std::atomic<double> looked_ = -1e9;  ///< time of the last status request
    bool told_last_ = false;             ///< whether a page has requested the status since its last change
    FileServer server_;
    std::thread thread_;
};

}  // namespace gs
