// SPDX-License-Identifier: Apache-2.0
// gsapp view's server: what it serves, and that nothing outside of its folder is.
#include "lib/export/file_server.h"

#include <httplib.h>

#include <thread>

#include "kernels/core/error.h"
#include "tests/io/file_helpers.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;

class Served : public ::testing::Test {
  protected:
    Served() {
        spit(folder_ / "secret.txt", "secret");
        spit(folder_ / "site/index.html", "<p>page</p>");
        spit(folder_ / "site/assets/a b.js", "script");
        spit(folder_ / "site/empty.txt", "");
        spit(folder_ / "site/scene.ngsplat", scene_);
        spit(folder_ / "site-2/x.txt", "secret");
        fs::create_symlink("../secret.txt", folder_ / "site/link.txt");
        fs::create_directory_symlink("..", folder_ / "site/up");
        fs::create_symlink("index.html", folder_ / "site/inside.html");
        server_ = std::make_unique<FileServer>(folder_ / "site", 0);
        thread_ = std::thread([this] { server_->run(); });
    }
    ~Served() override {
        get("/");  // the server runs: stop() would not be noticed before
        server_->stop();
        thread_.join();
    }
    httplib::Result get(const std::string& path, const httplib::Headers& headers = {}) {
        httplib::Client client("127.0.0.1", server_->port());
        client.set_url_encode(false);  // paths as they are
        return client.Get(path, headers);
    }
    int status(const std::string& path) {
        const auto result = get(path);
        if (!result) return -1;
        EXPECT_EQ(result->body.find("secret"), std::string::npos) << path;
        return result->status;
    }

    TempFolder folder_;
    const std::string scene_ = std::string(3'000'000, 's') + "end";
    std::unique_ptr<FileServer> server_;
    std::thread thread_;
};

TEST_F(Served, FilesOfTheFolder) {
    const auto page = get("/");
    ASSERT_TRUE(page);
    EXPECT_EQ(page->status, 200);
    EXPECT_EQ(page->body, "<p>page</p>");
    EXPECT_EQ(page->get_header_value("Content-Type"), "text/html; charset=utf-8");
    EXPECT_EQ(get("/index.html?model=x")->body, page->body);
    EXPECT_EQ(get("/inside.html")->body, page->body) << "a link that stays inside";
    EXPECT_EQ(get("/assets/a%20b.js")->body, "script");
    EXPECT_EQ(get("/empty.txt")->status, 200);
    EXPECT_EQ(get("/scene.ngsplat")->body, scene_);
    EXPECT_EQ(get("/scene.ngsplat", {httplib::make_range_header({{2'999'998, 3'000'001}})})->body, "ssen");
}

TEST_F(Served, NothingElse) {
    for (const char* path :
         {"/nothing", "/assets", "/up", "/../secret.txt", "/%2e%2e/secret.txt", "/..%2fsecret.txt",
          "/assets/../../secret.txt", "/assets/..%2f..%2fsecret.txt", "/../site-2/x.txt", "/link.txt", "/up/secret.txt",
          "//etc/passwd", "///etc/passwd", "/%2fetc/passwd", "/index.html%00.txt"})
        EXPECT_EQ(status(path), 404) << path;
    const std::string absolute = (folder_ / "secret.txt").string();
    EXPECT_EQ(status(absolute), 404);
    EXPECT_EQ(status("/" + absolute), 404);
}

TEST_F(Served, ScenesToThePapersViewerButNothingToOtherSites) {
    const char* allowed = "Access-Control-Allow-Origin";
    EXPECT_EQ(get("/scene.ngsplat")->get_header_value(allowed), "https://fhahlbohm.github.io");
    EXPECT_EQ(get("/scene.ngsplat", {httplib::make_range_header({{0, 10}})})->get_header_value(allowed),
              "https://fhahlbohm.github.io");
    for (const char* path : {"/", "/assets/a%20b.js", "/empty.txt", "/nothing.ngsplat"})
        EXPECT_FALSE(get(path)->has_header(allowed)) << path;
}

TEST_F(Served, FilesAreOnlyRead) {
    httplib::Client client("127.0.0.1", server_->port());
    for (const auto& result : {client.Post("/index.html", "x", "text/plain"), client.Put("/new.txt", "x", "text/plain"),
                               client.Delete("/index.html")}) {
        ASSERT_TRUE(result);
        EXPECT_EQ(result->status, 404);
    }
    EXPECT_EQ(slurp(folder_ / "site/index.html"), "<p>page</p>");
    EXPECT_FALSE(fs::exists(folder_ / "site/new.txt"));
}

TEST_F(Served, APortOrFolderThatCannotBeUsedIsNamed) {
    EXPECT_CONTAINS(message_of<DataError>([&] { FileServer(folder_ / "site", server_->port()); }),
                    std::to_string(server_->port()));
    EXPECT_CONTAINS(message_of<UsageError>([&] { FileServer(folder_ / "nowhere", 0); }), "nowhere");
    EXPECT_CONTAINS(message_of<UsageError>([&] { FileServer(folder_ / "secret.txt", 0); }), "secret.txt");
}

}  // namespace
}  // namespace gs::test
