// SPDX-License-Identifier: Apache-2.0
// What a page that watches a model is told, and who may press its buttons.
#include "apps/gsapp/live/live_page.h"

#include <gtest/gtest.h>
#include <fstream>
#include <numeric>

#include "apps/gsapp/live/live_training.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "lib/export/site.h"
#include "tests/core/temporary_folder.h"
#include "tests/export/http_client.h"

namespace gs::test {
namespace {

View view_of(int width, int height, int channels) {
    View view;
    view.camera.width = width, view.camera.height = height;
    view.load = [=] {
        ViewImage image;
        image.color = {
            width, height, channels, std::vector<std::uint8_t>(std::size_t(width) * height * channels, 0), {}};
        return image;
    };
    return view;
}

class Page : public ::testing::Test {
  protected:
    void SetUp() override {
        if (viewer_folder().empty()) GTEST_SKIP() << "the viewer is not built (scripts/build-viewer)";
        View bad = view_of(4, 4, 3);
        bad.load = []() -> ViewImage { throw DataError("gone"); };
        page_.emplace(LivePageFacts{.scene = "s \"quoted\" \xff",
                                    .appearance = "sh",
                                    .run = "run",
                                    .log = folder_.path() / "train.jsonl",
                                    .views = {view_of(5, 3, 4), view_of(4000, 10, 3), bad},
                                    .background = {1, 1, 1},
                                    .controls = true},
                      0);
        const std::string address = page_->address();
        port_ = std::stoi(address.substr(address.rfind(':') + 1));
        token_ = address.substr(address.find("token=") + 6);
    }
    HttpResult get(const std::string& path, const std::string& method = "GET", const std::string& fields = "") {
        return http_get(port_, path, fields, method);
    }
    HttpResult post(const std::string& name, const std::string& token) {
        return get("/live/" + name, "POST", "X-Gsapp-Token: " + token + "\r\nContent-Length: 0\r\n");
    }
    nlohmann::json status() { return parse_json(get("/live/status.json").body); }

    TemporaryFolder folder_;
    std::optional<LivePage> page_;
    int port_ = 0;
    std::string token_;
};

TEST_F(Page, TellsWhatIsKnown) {
    EXPECT_FALSE(page_->watched()) << "nobody has asked yet";
    page_->tell({{"state", "training"}, {"iteration", 70}});
    const nlohmann::json json = status();
    EXPECT_TRUE(page_->watched());
    EXPECT_EQ(json["state"], "training");
    EXPECT_EQ(json["iteration"], 70);
    EXPECT_EQ(json["photographs"], 3);
    EXPECT_TRUE(json["model"].is_null());
    page_->add_psnr(70, 20.5, "2 test views");
    EXPECT_EQ(status()["psnr_curve"]["values"], nlohmann::json({20.5}));
    EXPECT_EQ(status()["psnr_of"], "2 test views");
}

TEST_F(Page, ShowsTheLatestSnapshotAlone) {
    EXPECT_EQ(get("/live/model-0.ngsplat").status, 404);
    folder_.write("a.ngsplat", "first");
    folder_.write("b.ngsplat", "second");
    page_->show(folder_.path() / "a.ngsplat", 100);
    EXPECT_EQ(get("/live/model-1.ngsplat").body, "first");
    page_->show(folder_.path() / "b.ngsplat", 200);
    EXPECT_EQ(status()["model"]["iteration"], 200);
    EXPECT_EQ(get("/" + status()["model"]["url"].get<std::string>()).body, "second");
    EXPECT_EQ(get("/live/model-1.ngsplat").body, "second") << "who was told of the first before it was replaced";
    for (const char* name : {"model-0.ngsplat", "model-3.ngsplat", "model-.ngsplat", "model-2", "model-2.ngsplat2"})
        EXPECT_EQ(get("/live/" + std::string(name)).status, 404) << name;
    EXPECT_EQ(get("/live/../live_page.h").status, 404);
}

TEST_F(Page, SendsPhotographsThatAScreenCanShow) {
    const HttpResult small = get("/live/photograph/0.jpg");
    EXPECT_EQ(small.status, 200);
    EXPECT_EQ(small.fields.at("Content-Type"), "image/jpeg");
    EXPECT_EQ(small.body.substr(0, 3), "\xff\xd8\xff");
    EXPECT_EQ(get("/live/photograph/1.jpg").status, 200) << "4000 pixels wide, and one high in the end";
    for (const char* missing : {"2.jpg", "3.jpg", "-1.jpg", "00.jpg", "0.png", "", "99999999999999999999.jpg"})
        EXPECT_EQ(get(std::string("/live/photograph/") + missing).status, 404) << missing;
}

TEST_F(Page, TakesItsButtonsFromTheOneWhoHasTheAddress) {
    for (const std::string& token : {std::string(), std::string("x"), token_ + "0", token_.substr(1)})
        for (const char* name : {"pause", "continue", "save", "stop"}) EXPECT_EQ(post(name, token).status, 403);
    EXPECT_FALSE(page_->requests().pause || page_->requests().save || page_->requests().stop);
    EXPECT_EQ(get("/live/stop", "GET", "X-Gsapp-Token: " + token_ + "\r\n").status, 404) << "a link presses nothing";
    EXPECT_EQ(get("/live/stop", "POST", "X-Gsapp-Token: " + token_ + "\r\nContent-Length: 1\r\n\r\nx").status, 405);
    EXPECT_EQ(post("explode", token_).status, 404);
    EXPECT_EQ(post("pause", token_).status, 200);
    EXPECT_TRUE(page_->requests().pause);
    EXPECT_EQ(post("continue", token_).status, 200);
    EXPECT_FALSE(page_->requests().pause);
    EXPECT_EQ(post("save", token_).status, 200);
    EXPECT_TRUE(page_->requests().save);
    page_->saved();
    EXPECT_FALSE(page_->requests().save);
    EXPECT_EQ(post("stop", token_).status, 200);
    EXPECT_TRUE(page_->requests().stop);
}

TEST_F(Page, RefusesAnotherHostsName) {
    HttpClient client(port_);
    client.send("GET /live/status.json HTTP/1.1\r\nHost: example.com\r\n\r\n");
    EXPECT_EQ(client.receive().status, 421);
    EXPECT_FALSE(page_->watched());
}

TEST_F(Page, LeadsToItself) {
    const HttpResult moved = get("/");
    EXPECT_EQ(moved.status, 302);
    EXPECT_EQ(moved.fields.at("Location"), "/?live");
    EXPECT_EQ(get("/?live").status, 200);
    EXPECT_NE(get("/?live").body.find("<title>gsapp viewer"), std::string::npos);
}

TEST_F(Page, WaitsForTheOneWhoIsWatchingAtTheEnd) {
    status();
    folder_.write("last.ngsplat", "last");
    page_->tell({{"state", "finished"}});
    page_->show(folder_.path() / "last.ngsplat", 300);
    std::thread reader([&] { get("/" + status()["model"]["url"].get<std::string>()); });
    const auto start = std::chrono::steady_clock::now();
    page_->linger(200);
    reader.join();
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(100));
}

TEST(LivePage, APortThatIsTakenIsNamed) {
    if (viewer_folder().empty()) GTEST_SKIP() << "the viewer is not built (scripts/build-viewer)";
    const LivePage first({}, 0);
    const std::string address = first.address();
    EXPECT_EQ(address.find("token"), std::string::npos) << "without buttons there is nothing to protect";
    const int port = std::stoi(address.substr(address.rfind(':') + 1));
    try {
        const LivePage second({}, port);
        ADD_FAILURE();
    } catch (const DataError& e) {
        EXPECT_NE(std::string(e.what()).find(std::to_string(port)), std::string::npos) << e.what();
    }
}

// The curves of a training, read while its log grows, and how often a training stops for those who watch.

void append(const std::filesystem::path& file, const std::string& text) {
    std::ofstream(file, std::ios::app | std::ios::binary) << text;
}

TEST(CourseLog, GrowsWithItsFile) {
    const test::TemporaryFolder tmp;
    const auto file = tmp.path() / "train.jsonl";
    CourseLog log(file);
    log.update();
    EXPECT_EQ(log.iteration(), 0) << "there is no file yet";
    append(file, R"({"event":"step","iteration":100,"loss":0.5,"num_gaussians":7,"train_seconds":1.5})"
                 "\n"
                 R"({"event":"step","itera)");
    log.update();
    EXPECT_EQ(log.loss().iterations, std::vector<std::int64_t>{100}) << "half a line is none";
    append(file, R"(tion":200,"loss":0.25,"num_gaussians":9,"train_seconds":3})"
                 "\n"
                 R"({"event":"target","iteration":200,"psnr":21.5})"
                 "\n");
    log.update();
    log.update();
    EXPECT_EQ(log.loss().iterations, (std::vector<std::int64_t>{100, 200}));
    EXPECT_EQ(log.loss().values, (std::vector<double>{0.5, 0.25}));
    EXPECT_EQ(log.psnr().values, std::vector<double>{21.5});
    EXPECT_EQ(log.iteration(), 200);
    EXPECT_EQ(log.num_gaussians(), 9);
    EXPECT_EQ(log.train_seconds(), 3);
}

TEST(CourseLog, BeginsAnewWithARunThatReplacesTheOneBefore) {
    const test::TemporaryFolder tmp;
    const auto file = tmp.path() / "train.jsonl";
    CourseLog log(file);
    append(file, "{\"event\":\"step\",\"iteration\":100,\"loss\":0.5}\n{\"event\":\"step\",\"iteration\":200}\n");
    log.update();
    std::ofstream(file, std::ios::trunc) << "{\"event\":\"step\",\"iteration\":100,\"loss\":4}\n";
    log.update();
    EXPECT_EQ(log.loss().values, std::vector<double>{4});
}

TEST(CourseLog, SkipsWhatIsNoLineOfALog) {
    const test::TemporaryFolder tmp;
    const auto file = tmp.path() / "train.jsonl";
    append(file,
           "\n[]\nnull\n{}\n{\"event\":\"step\"}\n{\"event\":\"step\",\"iteration\":\"x\"}\n\xff\xfe\n"
           "{\"event\":7,\"iteration\":1}\n{\"event\":\"step\",\"iteration\":300,\"loss\":null}\n");
    CourseLog log(file);
    log.update();
    EXPECT_EQ(log.loss().iterations, std::vector<std::int64_t>{300});
    EXPECT_TRUE(log.loss().json(10)["values"][0].is_null());
}

TEST(Curve, KeepsItsLastPointWhereItIsThinned) {
    Curve curve;
    for (int k = 1; k <= 1234; ++k) curve.add(k, k);
    for (const std::size_t most : {1u, 7u, 500u, 1234u, 5000u}) {
        const auto json = curve.json(most);
        EXPECT_LE(json["iterations"].size(), most);
        EXPECT_GE(2 * json["iterations"].size(), std::min<std::size_t>(most, 1234));
        EXPECT_EQ(json["iterations"].back(), 1234);
        EXPECT_EQ(json["values"].back(), 1234);
    }
    EXPECT_TRUE(Curve().json(5)["values"].empty());
}

TEST(Throttle, TakesAtMostItsShare) {
    Throttle pace;
    double now = 10, worked = 0;
    for (const double start = now; now < start + 1000; now += 0.01) {
        if (!pace.due(now)) continue;
        const double cost = 0.2;
        pace.spent(now, cost);
        worked += cost, now += cost;
    }
    EXPECT_LT(worked / 1000, Throttle::kMostShare * 1.01);
    EXPECT_GT(worked / 1000, Throttle::kMostShare * 0.9) << "and not much less";
    pace.spent(now, 1e-9);
    EXPECT_FALSE(pace.due(now + 1.9));
    EXPECT_TRUE(pace.due(now + 2.1));
}

}  // namespace
}  // namespace gs::test
