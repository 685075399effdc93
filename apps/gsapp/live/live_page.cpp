// SPDX-License-Identifier: Apache-2.0
// Answers the requests of a page that watches a model, packs the model for it, and reads the log that another thread or
// program is writing.
#include "apps/gsapp/live/live_page.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <random>

#include "eval/runs/evaluate.h"
#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/version.h"
#include "lib/export/pack_scene.h"
#include "lib/export/site.h"
#include "lib/io/image.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

constexpr int kUsualPort = 8000;
/// Seconds without a request after which nobody is watching; a page sends one every second.
constexpr double kLooksAwayAfter = 4;
constexpr std::size_t kMostPoints = 500;  ///< of a curve
constexpr int kMostPixels = 1600;         ///< along the longer side of a photograph
constexpr int kJpegQuality = 90;

/// Returns 128 random bits in hexadecimal.
std::string random_name() {
    std::random_device random;
    std::string name;
    for (int k = 0; k < 4; ++k) name += fmt::format("{:08x}", random());
    return name;
}

std::filesystem::path built_viewer() {
    const std::filesystem::path folder = viewer_folder();
    if (folder.empty()) throw DataError("the web viewer is not built; scripts/build-viewer builds it");
    return folder;
}

FileServer serve(std::optional<int> port, const WebHandler& handler) {
    const std::filesystem::path viewer = built_viewer();
    if (port) return FileServer(viewer, *port, handler);
    try {
        return FileServer(viewer, kUsualPort, handler);
    } catch (const DataError&) {  // most likely in use by another run
        return FileServer(viewer, 0, handler);
    }
}

/// Returns the photograph of a view, reduced to screen size.
Image shown_photograph(const View& view, const Vec3<float>& background) {
    Image image = photograph_of(view, background);
    const double scale = double(kMostPixels) / std::max(image.width, image.height);
    if (scale >= 1) return image;
    return resize_image(image, std::max(1, int(std::lround(scale * image.width))),
                        std::max(1, int(std::lround(scale * image.height))));
}

/// Returns N of "model-N.ngsplat", or 0.
std::int64_t number_of_model(const std::string& name) {
    std::int64_t n = 0;
    const std::string before = "model-", after = ".ngsplat";
    if (name.rfind(before, 0) != 0) return 0;
    const char* const begin = name.data() + before.size();
    const char* const end = name.data() + name.size();
    const auto [rest, error] = std::from_chars(begin, end, n);
    return error == std::errc() && std::string_view(rest, std::size_t(end - rest)) == after ? n : 0;
}

}  // namespace

nlohmann::ordered_json Curve::json(std::size_t most) const {
    nlohmann::ordered_json x = nlohmann::ordered_json::array(), y = x;
    const std::size_t size = values.size(), step = (size + most - 1) / most;
    for (std::size_t k = 0; k < size; k += step) {
        // Counts from the end, so that the last value is always included.
        const std::size_t i = (size - 1) % step + k;
        x.push_back(iterations[i]);
        y.push_back(std::isfinite(values[i]) ? nlohmann::ordered_json(values[i]) : nlohmann::ordered_json());
    }
    return {{"iterations", x}, {"values", y}};
}

void CourseLog::update() {
    struct stat status = {};
    if (::stat(file_.c_str(), &status) != 0) return;
    if (std::uintmax_t(status.st_ino) != inode_ || std::uintmax_t(status.st_size) < read_) *this = CourseLog(file_);
    inode_ = status.st_ino;
    if (std::uintmax_t(status.st_size) == read_) return;
    std::ifstream in(file_, std::ios::binary);
    in.seekg(std::streamoff(read_));
    for (std::string line; std::getline(in, line) && !in.eof(); read_ += line.size() + 1) read_line(line);
}

void CourseLog::read_line(const std::string& line) {
    const nlohmann::json json = try_parse_json(line);
    if (!json.is_object() || !json.contains("iteration") || !json["iteration"].is_number_integer()) return;
    const auto number = [&](const char* name) {
        const auto found = json.find(name);
        return found != json.end() && found->is_number() ? found->get<double>() : NAN;
    };
    const std::int64_t at = json["iteration"].get<std::int64_t>();
    const nlohmann::json event = json.value("event", nlohmann::json());
    if (event == "step") {
        loss_.add(at, number("loss"));
        iteration_ = at;
        if (const double n = number("num_gaussians"); std::isfinite(n)) num_gaussians_ = std::int64_t(n);
        if (const double s = number("train_seconds"); std::isfinite(s)) train_seconds_ = s;
    } else if (event == "target" || event == "evaluation") {
        psnr_.add(at, number("psnr"));
    }
}

void write_snapshot(const std::filesystem::path& file, const Gaussians& model, const SnapshotFacts& facts) {
    require_finite(model);
    const Gaussians visible = visible_gaussians(model);
    PackedScene scene = pack_gaussians(visible);
    add_cameras(scene, visible, facts.views);
    if (model.ppisp.active()) {
        scene.ppisp = pack_ppisp(model.ppisp);
        scene.ppisp->views.resize(facts.views.size());
    }
    nlohmann::ordered_json trailer = {{"generator", version_text()},
                                      {"scene", facts.scene},
                                      {"appearance", model.appearance.model},
                                      {"iteration", facts.iteration},
                                      {"background", {facts.background.x, facts.background.y, facts.background.z}},
                                      {"num_gaussians", scene.count()},
                                      {"bytes_per_gaussian", scene.mean_bytes_per_gaussian()}};
    if (facts.are_training_views) trailer["views"] = "training";
    if (!facts.frame.is_identity()) trailer["frame"] = frame_json(facts.frame);
    scene.trailer = json_text(trailer);
    write_ngsplat(file, scene);
}

LivePage::LivePage(LivePageFacts facts, std::optional<int> port)
    : facts_(std::move(facts)),
      token_(random_name()),
      id_(random_name()),
      course_(facts_.log),
      server_(serve(port, [this](const WebRequest& request) { return answer(request); })) {
    thread_ = std::thread([this] {
        try {
            server_.run(false);  // keeps serving, so that a page learns that its training was interrupted
        } catch (const std::exception& e) {
            log_warning("the page is served no more: {}", e.what());
        }
    });
}

LivePage::~LivePage() {
    server_.stop();
    thread_.join();
}

std::string LivePage::address() const {
    const std::string query = facts_.controls ? "?live&token=" + token_ : "?live";
    return fmt::format("http://127.0.0.1:{}/{}", server_.port(), query);
}

bool LivePage::watched() const { return seconds_now() - looked_ < kLooksAwayAfter; }

void LivePage::tell(const nlohmann::ordered_json& fields) {
    const std::lock_guard lock(mutex_);
    state_.update(fields);
    told_last_ = false;
}

void LivePage::show(const std::filesystem::path& snapshot, std::int64_t iteration) {
    const std::lock_guard lock(mutex_);
    snapshot_ = snapshot;
    snapshot_iteration_ = iteration;
    ++version_;
    told_last_ = false;
}

void LivePage::add_psnr(std::int64_t iteration, double psnr, const std::string& what) {
    const std::lock_guard lock(mutex_);
    psnr_.add(iteration, psnr);
    psnr_of_ = what;
}

WatcherRequests LivePage::requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
}

void LivePage::saved() {
    const std::lock_guard lock(mutex_);
    requests_.save = false;
}

void LivePage::linger(double seconds) {
    const auto is_done = [&] {
        const std::lock_guard lock(mutex_);
        return told_last_ && (version_ == 0 || fetched_ == version_) &&
               std::all_of(transfers_.begin(), transfers_.end(), [](const auto& one) { return one.expired(); });
    };
    for (const double end = seconds_now() + seconds; seconds_now() < end && watched() && !is_done();)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

std::optional<WebAnswer> LivePage::answer(const WebRequest& request) {
    const std::string& path = request.path;
    if (path == "/" && !request.query.contains("live")) {
        if (request.method == "POST") return std::nullopt;
        WebAnswer page{.status = 302};
        page.location = "/?live";
        return page;
    }
    const std::string room = "/live/";
    if (path.rfind(room, 0) != 0) return std::nullopt;
    const std::string name = path.substr(room.size());
    if (request.method == "POST") return control(request);
    if (name == "status.json") return status();
    if (name.rfind("photograph/", 0) == 0) return photograph(name.substr(std::string("photograph/").size()));
    const std::lock_guard lock(mutex_);
    // A page may request a snapshot after the next one has replaced it: it receives the newer one.
    if (const std::int64_t asked = number_of_model(name); asked < 1 || asked > version_)
        return WebAnswer{.status = 404};
    fetched_ = version_;
    WebAnswer model;
    model.file = snapshot_;
    model.held = std::make_shared<int>();
    transfers_.erase(
        std::remove_if(transfers_.begin(), transfers_.end(), [](const auto& one) { return one.expired(); }),
        transfers_.end());
    transfers_.push_back(model.held);
    return model;
}

WebAnswer LivePage::status() {
    looked_ = seconds_now();
    const std::lock_guard lock(mutex_);
    told_last_ = true;
    course_.update();
    nlohmann::ordered_json json = {{"id", id_},
                                   {"program", version_text()},
                                   {"scene", facts_.scene},
                                   {"appearance", facts_.appearance},
                                   {"run", facts_.run},
                                   {"controls", facts_.controls},
                                   {"iteration", course_.iteration()},
                                   {"num_gaussians", course_.num_gaussians()},
                                   {"train_seconds", course_.train_seconds()}};
    json.update(state_);
    json["save_pending"] = requests_.save;
    json["model"] = version_ == 0 ? nlohmann::ordered_json()
                                  : nlohmann::ordered_json({{"version", version_},
                                                            {"iteration", snapshot_iteration_},
                                                            {"url", fmt::format("live/model-{}.ngsplat", version_)}});
    json["photographs"] = facts_.views.size();
    json["loss_curve"] = course_.loss().json(kMostPoints);
    const bool own = !psnr_.values.empty();
    json["psnr_curve"] = (own ? psnr_ : course_.psnr()).json(kMostPoints);
    json["psnr_of"] = own ? psnr_of_ : "held-out views";
    WebAnswer answer;
    answer.text = json_text(json);
    return answer;
}

WebAnswer LivePage::photograph(const std::string& name) {
    for (std::size_t k = 0; k < facts_.views.size(); ++k) {
        if (name != fmt::format("{}.jpg", k)) continue;
        try {
            const std::vector<std::uint8_t> bytes =
                encode_jpeg(shown_photograph(facts_.views[k], facts_.background), kJpegQuality);
            WebAnswer picture;
            picture.type = "image/jpeg";
            picture.text.assign(bytes.begin(), bytes.end());
            return picture;
        } catch (const std::exception& e) {  // the training itself reports images that have become unreadable
            log_debug("photograph {}: {}", facts_.views[k].name, e.what());
        }
    }
    return {.status = 404};
}

WebAnswer LivePage::control(const WebRequest& request) {
    if (!facts_.controls || request.token != token_) return {.status = 403};
    const std::string name = request.path.substr(std::string("/live/").size());
    const std::lock_guard lock(mutex_);
    if (name == "pause")
        requests_.pause = true;
    else if (name == "continue")
        requests_.pause = false;
    else if (name == "save")
        requests_.save = true;
    else if (name == "stop")
        requests_.stop = true;
    else
        return {.status = 404};
    WebAnswer done;
    done.text = "{}";
    return done;
}

}  // namespace gs
