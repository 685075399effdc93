// SPDX-License-Identifier: Apache-2.0
// gsapp view's server: what it serves, that nothing outside of its folder is, and that no client keeps it from others.
#include "lib/export/file_server.h"

#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <list>
#include <thread>
#include <vector>

#include "kernels/base/error.h"
#include "tests/export/http_client.h"
#include "tests/io/file_helpers.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

/// Both ends of a connection are in the process of the tests.
void allow_many_open_files() {
    rlimit files = {};
    ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &files), 0);
    files.rlim_cur = std::min<rlim_t>(files.rlim_max, 4096);
    ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &files), 0);
}

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
        fs::create_symlink("loop", folder_ / "site/loop");
        EXPECT_EQ(::mkfifo((folder_ / "site/pipe").c_str(), 0600), 0);
        server_ = std::make_unique<FileServer>(folder_ / "site", 0);
        thread_ = std::thread([this] { server_->run(); });
    }
    ~Served() override {
        server_->stop();
        thread_.join();
    }
    int port() const { return server_->port(); }
    HttpResult get(const std::string& path, const std::string& fields = "", const std::string& method = "GET") {
        return http_get(port(), path, fields, method);
    }
    /// Returns the status of the answer to any bytes.
    int status_of(const std::string& bytes) {
        HttpClient client(port());
        client.send(bytes);
        const HttpResult result = client.receive();
        EXPECT_EQ(result.body.find("secret"), std::string::npos) << bytes.substr(0, 100);
        return result.status;
    }
    int status(const std::string& path) { return status_of(http_request(path)); }

    TempFolder folder_;
    const std::string scene_ = std::string(3'000'000, 's') + "end";
    std::unique_ptr<FileServer> server_;
    std::thread thread_;
};

TEST_F(Served, FilesOfTheFolder) {
    const HttpResult page = get("/");
    EXPECT_EQ(page.status, 200);
    EXPECT_EQ(page.body, "<p>page</p>");
    EXPECT_EQ(page.fields.at("Content-Type"), "text/html; charset=utf-8");
    EXPECT_EQ(get("/index.html?model=x").body, page.body);
    EXPECT_EQ(get("/inside.html").body, page.body) << "a link that stays inside";
    EXPECT_EQ(get("/assets/a%20b.js").body, "script");
    EXPECT_EQ(get("/empty.txt").status, 200);
    EXPECT_EQ(get("/scene.ngsplat").body, scene_);
}

TEST_F(Served, NothingElse) {
    for (const char* path : {"/nothing",
                             "/assets",
                             "/up",
                             "/../secret.txt",
                             "/%2e%2e/secret.txt",
                             "/..%2fsecret.txt",
                             "/assets/../../secret.txt",
                             "/assets/..%2f..%2fsecret.txt",
                             "/../site-2/x.txt",
                             "/link.txt",
                             "/up/secret.txt",
                             "//etc/passwd",
                             "///etc/passwd",
                             "/%2fetc/passwd",
                             "/index.html%00.txt",
                             "/loop",
                             "/loop/x",
                             "/pipe",
                             "/index.html/",
                             "/%2",
                             "/%zz",
                             "/%ff%fe"})
        EXPECT_EQ(status(path), 404) << path;
    const std::string absolute = (folder_ / "secret.txt").string();
    EXPECT_EQ(status(absolute), 404);
    EXPECT_EQ(status("/" + absolute), 404);
    EXPECT_EQ(status("/" + std::string(300, 'n')), 404) << "a name that no file can have";
    EXPECT_EQ(status("/" + std::string(7000, 'n')), 404) << "a path that no file can have";
}

TEST_F(Served, RangesOfAFile) {
    const auto range = [&](const std::string& value) { return get("/scene.ngsplat", "Range: " + value + "\r\n"); };
    for (const auto& [value, content_range, body] :
         {std::tuple("bytes=2999998-3000001", "bytes 2999998-3000001/3000003", "ssen"),
          std::tuple("bytes=2999999-", "bytes 2999999-3000002/3000003", "send"),
          std::tuple("bytes=-3", "bytes 3000000-3000002/3000003", "end"),
          std::tuple("bytes=3000002-999999999999", "bytes 3000002-3000002/3000003", "d")}) {
        const HttpResult part = range(value);
        EXPECT_EQ(part.status, 206) << value;
        EXPECT_EQ(part.fields.at("Content-Range"), content_range) << value;
        EXPECT_EQ(part.body, body) << value;
    }
    EXPECT_EQ(range("bytes=-999999999999").body, scene_);
    for (const char* beyond :
         {"bytes=3000003-", "bytes=3000003-3000010", "bytes=-0", "bytes=9223372036854775807-9223372036854775807"}) {
        const HttpResult refused = range(beyond);
        EXPECT_EQ(refused.status, 416) << beyond;
        EXPECT_EQ(refused.fields.at("Content-Range"), "bytes */3000003") << beyond;
    }
    // RFC 9110, 14.2: what is malformed or of another unit is ignored; sets of several ranges may be.
    for (const char* ignored : {"bytes=5-4", "bytes=-", "bytes=", "bytes", "bytes=x-5", "bytes=1-x", "bytes=--5",
                                "lines=1-2", "bytes=0-0,5-6", "bytes=+1-2", "bytes=0x1-2", "Bytes=1-2",
                                "bytes=18446744073709551615-", "bytes=0-1,9-18446744073709551615"})
        EXPECT_EQ(range(ignored).status, 200) << ignored;
    EXPECT_EQ(get("/nothing", "Range: lines=1-2\r\n").status, 404);
    EXPECT_EQ(get("/nothing", "Range: bytes=0-2\r\n").body, "not found\n") << "no range of the sentence";
    EXPECT_EQ(get("/scene.ngsplat", "Range: bytes=0-1\r\nIf-Range: \"other\"\r\n").status, 200);
    EXPECT_EQ(get("/empty.txt", "Range: bytes=0-\r\n").status, 416);
    EXPECT_EQ(get("/empty.txt", "Range: bytes=-5\r\n").status, 200);
}

TEST_F(Served, HeadsWithoutBodies) {
    HttpClient client(port());
    client.send(http_request("/scene.ngsplat", "Range: bytes=0-1\r\n", "HEAD"));
    const HttpResult head = client.receive(false);
    EXPECT_EQ(head.status, 200) << "a range is for GET alone";
    EXPECT_EQ(head.fields.at("Content-Length"), "3000003");
    client.send(http_request("/"));
    EXPECT_EQ(client.receive().body, "<p>page</p>") << "nothing lies between";
    EXPECT_EQ(get("/nothing", "", "HEAD").status, 404);
}

TEST_F(Served, ScenesToThePapersViewerButNothingToOtherSites) {
    const char* allowed = "Access-Control-Allow-Origin";
    EXPECT_EQ(get("/scene.ngsplat").fields.at(allowed), "https://fhahlbohm.github.io");
    EXPECT_EQ(get("/scene.ngsplat", "Range: bytes=0-10\r\n").fields.at(allowed), "https://fhahlbohm.github.io");
    for (const char* path : {"/", "/assets/a%20b.js", "/empty.txt", "/nothing.ngsplat"})
        EXPECT_FALSE(get(path).fields.contains(allowed)) << path;
}

TEST_F(Served, FilesAreOnlyRead) {
    for (const char* method : {"POST", "PUT", "DELETE", "PATCH", "OPTIONS"}) {
        const HttpResult result = get("/index.html", "Content-Length: 1\r\n", method);
        EXPECT_EQ(result.status, 405) << method;
        EXPECT_EQ(result.fields.at("Allow"), "GET, HEAD");
    }
    EXPECT_EQ(slurp(folder_ / "site/index.html"), "<p>page</p>");
}

TEST_F(Served, OnlyThisMachineAsHost) {
    const auto with_host = [&](const std::string& host, const std::string& target = "/") {
        return status_of("GET " + target + " HTTP/1.1\r\nHost: " + host + "\r\n\r\n");
    };
    for (const char* host :
         {"localhost", "localhost:8000", "127.0.0.1:8000", "[::1]:8000", "LocalHost:1", "[::1]", "localhost:"})
        EXPECT_EQ(with_host(host), 200) << host;
    for (const char* host : {"evil.example", "evil.example:8000", "localhost.evil.example", "127.0.0.1.evil.example",
                             "localhost:80x", "127.0.0.2", "0.0.0.0", "[::1", "[::1]x", "[::2]", ":8000",
                             "localhost@evil.example", "localhost, evil.example", "localhost:123456"})
        EXPECT_EQ(with_host(host), 421) << host;
    EXPECT_EQ(with_host("evil.example", "http://localhost/"), 421);
    EXPECT_EQ(with_host("localhost", "http://evil.example/"), 404);
    HttpClient client(port());
    client.send("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n");
    EXPECT_EQ(client.receive().body,
              "this server answers for localhost, 127.0.0.1 and [::1] alone, not for another host\n");
}

TEST_F(Served, ABodyIsNoRequest) {
    const std::string filler(10000, 'x');  // more than the server reads ahead
    for (const char* fields : {"", "Range: lines=1-2\r\n"}) {
        HttpClient client(port());
        client.send("POST / HTTP/1.1\r\nHost: evil.example\r\n" + std::string(fields) +
                    "Content-Length: 10100\r\n\r\n" + filler);
        EXPECT_EQ(client.receive().status, 421);
        client.send("\r\n" + http_request("/"));
        EXPECT_TRUE(client.is_ended());
    }
}

TEST_F(Served, WhatIsNoRequestIsRefused) {
    const std::string host = "Host: localhost\r\n";
    for (const std::string& bytes : std::vector<std::string>{
             "nonsense\r\n\r\n", "\x16\x03\x01\x02\r\n\r\n", "GET /\r\n" + host + "\r\n",
             "GET /a b HTTP/1.1\r\n" + host + "\r\n", "G(T / HTTP/1.1\r\n" + host + "\r\n", "GET / HTTP/1.1\r\n\r\n",
             "GET / HTTP/2.0\r\n" + host + "\r\n", "GET / HTTP/1.1\r\nHost : localhost\r\n\r\n",
             "GET / HTTP/1.1\r\nHost: \r\n\r\n", "GET / HTTP/1.1\r\n" + host + host + "\r\n",
             "GET / HTTP/1.1\r\n" + host + "X: " + std::string(17000, 'x') + "\r\n\r\n"})
        EXPECT_EQ(status_of(bytes), 400) << bytes.substr(0, 100);
    EXPECT_EQ(status("/" + std::string(8192, 'x')), 414);
    // The library matches by regular expressions, which recurse.
    EXPECT_EQ(get("/", "Range: bytes=" + std::string(8100, '1') + "-\r\n").status, 200);
    std::string ranges = "bytes=0-0";
    while (ranges.size() < 8100) ranges += ",0-0";
    EXPECT_EQ(get("/", "Range: " + ranges + "\r\n").status, 200);
    EXPECT_EQ(status_of("GET / HTTP/1.1\r\nHost: localhost:" + std::string(8100, '1') + "\r\n\r\n"), 421);
}

TEST_F(Served, ManyRequestsOverOneConnection) {
    HttpClient client(port());
    std::vector<std::chrono::steady_clock::duration> took;
    for (int i = 0; i < 100; ++i) {
        const auto start = std::chrono::steady_clock::now();
        ASSERT_TRUE(client.send(http_request("/assets/a%20b.js")));
        ASSERT_EQ(client.receive().body, "script") << i;
        took.push_back(std::chrono::steady_clock::now() - start);
    }
    // The slower ones may have waited for a processor.
    std::sort(took.begin(), took.end());
    EXPECT_LT(took[30], milliseconds(30)) << "40 ms each: acknowledged too late";
    client.send(http_request("/", "Connection: close\r\n"));
    EXPECT_EQ(client.receive().body, "<p>page</p>");
    EXPECT_TRUE(client.is_ended());
}

/// As the pictures of a training are, while a browser asks for them.
TEST_F(Served, FilesThatAreReplacedArriveWhole) {
    const std::string texts[] = {std::string(10, 'a'), std::string(40'000, 'b')};
    spit(folder_ / "site/live.txt", texts[0]);
    std::atomic<bool> stop = false;
    std::thread writer([&] {
        for (int k = 1; !stop; ++k) {
            spit(folder_ / "next.txt", texts[k % 2]);
            fs::rename(folder_ / "next.txt", folder_ / "site/live.txt");
        }
    });
    int broken = 0;
    for (int k = 0; k < 200; ++k) {
        const HttpResult result = get("/live.txt");
        broken += result.body != texts[0] && result.body != texts[1];
    }
    stop = true;
    writer.join();
    EXPECT_EQ(broken, 0);
}

TEST_F(Served, IdleAndTricklingClientsDelayNobodyAndDoNotKeepTheServerFromStopping) {
    allow_many_open_files();
    std::list<HttpClient> idle, trickling, deaf;
    for (int i = 0; i < 300; ++i) {
        idle.emplace_back(port());
        trickling.emplace_back(port()).send("GET / HTTP/1.1\r\nX");
        if (i < 50) deaf.emplace_back(port()).send(http_request("/scene.ngsplat"));  // 3 MB that nobody takes
    }
    EXPECT_EQ(get("/").status, 200) << "within the ten seconds that a client waits";
    EXPECT_EQ(get("/scene.ngsplat").body, scene_);
    std::atomic<bool> goes_on = true;
    std::thread trickle([&] {
        for (; goes_on; std::this_thread::sleep_for(milliseconds(100)))
            for (const HttpClient& client : trickling) client.send("x");
    });
    EXPECT_TRUE(idle.back().is_ended(60)) << "idle clients give their place back";
    const auto stop = std::chrono::steady_clock::now();
    server_->stop();
    thread_.join();
    EXPECT_LT(std::chrono::steady_clock::now() - stop, std::chrono::seconds(60)) << "trickling goes on";
    thread_ = std::thread([] {});
    goes_on = false;
    trickle.join();
}

TEST_F(Served, MoreClientsThanItHasRoomForWaitForIdleOnesToEnd) {
    allow_many_open_files();
    std::list<HttpClient> idle;
    for (int i = 0; i < 1000; ++i) idle.emplace_back(port());
    EXPECT_EQ(status("/"), 200);
    for (int i = 0; i < 2000; ++i) HttpClient(port()).send("GET");
    EXPECT_EQ(status("/"), 200);
}

TEST(FileServer, StopsThoughItWasStoppedBeforeItRan) {
    const TempFolder folder;
    FileServer server(folder.path(), 0);
    server.stop();
    server.run();
}

TEST_F(Served, APortOrFolderThatCannotBeUsedIsNamed) {
    EXPECT_CONTAINS(message_of<DataError>([&] { FileServer(folder_ / "site", port()); }), std::to_string(port()));
    EXPECT_CONTAINS(message_of<UsageError>([&] { FileServer(folder_ / "nowhere", 0); }), "nowhere");
    EXPECT_CONTAINS(message_of<UsageError>([&] { FileServer(folder_ / "secret.txt", 0); }), "secret.txt");
}

}  // namespace
}  // namespace gs::test
