// SPDX-License-Identifier: Apache-2.0
// gsapp view as a process: the address it prints answers, a folder without an export is named, and Ctrl-C ends it.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <list>
#include <thread>

#include "lib/export/file_server.h"
#include "tests/apps/program.h"
#include "tests/export/http_client.h"

namespace gs::test {
namespace {

TEST(View, AFolderWithoutAnExportIsNamed) {
    const Program program;
    std::filesystem::create_directory(program.path("run"));
    program.folder().write("run/results.json", "{}");
    const Outcome empty = program.run("view run --port 0", "timeout 100");
    EXPECT_EQ(empty.exit_code, 3) << empty.err;
    EXPECT_EQ(empty.out, "");
    EXPECT_NE(empty.err.find("'run' holds no export"), std::string::npos) << empty.err;
    EXPECT_NE(empty.err.find("gsapp export RUN -o DIR"), std::string::npos) << empty.err;
    EXPECT_EQ(program.run("view nowhere --port 0", "timeout 100").exit_code, 2);
}

TEST(View, ARunAndAPointCloudThatCannotBeShownAreNamed) {
    const Program program;
    program.folder().write("bad.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 5\n");
    const Outcome ply = program.run("view bad.ply --port 0", "timeout 100");
    EXPECT_EQ(ply.exit_code, 3) << ply.err;
    EXPECT_NE(ply.err.find("bad.ply"), std::string::npos) << ply.err;
    std::filesystem::create_directory(program.path("run"));
    program.folder().write("run/config.yaml", "source: builtin:diffuse\n");
    const Outcome run = program.run("view run --port 0", "timeout 100");
    EXPECT_EQ(run.exit_code, 3) << run.err;
    EXPECT_NE(run.err.find("saved no model"), std::string::npos) << run.err;
    program.folder().write("scene.spz", "NGSP");
    const Outcome other = program.run("view scene.spz --port 0", "timeout 100");
    EXPECT_EQ(other.exit_code, 3) << other.err;
    EXPECT_NE(other.err.find("npx @playcanvas/splat-transform scene.spz scene.ply"), std::string::npos) << other.err;
}

TEST(View, ATrainingWhosePageCannotBeServedDoesNotBegin) {
    const Program program;
    const std::string train = "train -s builtin:diffuse -r 8 --iterations 2 --device cpu -m run";
    ASSERT_EQ(program.run(train).exit_code, 0);
    const std::string before = program.read("run/stats/train.jsonl");
    for (const char* port : {"99999", "-1", "x"}) {
        const Outcome outcome = program.run(train + " --overwrite --view=" + port);
        EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
        EXPECT_NE(outcome.err.find("option view"), std::string::npos) << outcome.err;
    }
    const FileServer taken(program.folder().path(), 0);
    const Outcome busy = program.run(train + " --overwrite --view " + std::to_string(taken.port()));
    EXPECT_EQ(busy.exit_code, 3) << busy.err;
    EXPECT_EQ(program.read("run/stats/train.jsonl"), before) << "the run of before is still there";
}

TEST(View, ThePrintedAddressAnswersAndCtrlCEndsItWhileClientsHang) {
    for (const std::string page : {"", "scene.ngsplat"}) {
        const Program program;
        std::filesystem::create_directory(program.path("site"));
        program.folder().write("site/scene.ngsplat", "the scene");
        if (page.empty()) program.folder().write("site/index.html", "the page");
        const std::string command =
            "echo $$; exec '" GSAPP_PROGRAM "' view '" + program.path("site").string() + "' --port 0 2>/dev/null";
        FILE* const out = ::popen(command.c_str(), "r");
        ASSERT_NE(out, nullptr);
        int process = 0, port = 0;
        char path[100] = "";
        ASSERT_EQ(std::fscanf(out, "%d ", &process), 1);
        EXPECT_EQ(std::fscanf(out, "http://127.0.0.1:%d/%99[^\n]", &port, path), page.empty() ? 1 : 2);
        EXPECT_EQ(path, page);
        std::list<HttpClient> clients;
        for (int i = 0; i < 20; ++i) clients.emplace_back(port).send("GET /");
        std::atomic<bool> goes_on = true;
        std::thread trickle([&] {  // lest their silence ends them
            for (; goes_on; std::this_thread::sleep_for(std::chrono::milliseconds(100)))
                for (const HttpClient& client : clients) client.send("x");
        });
        const HttpResult result = http_get(port, "/" + std::string(path));
        EXPECT_EQ(result.status, 200);
        EXPECT_EQ(result.body, page.empty() ? "the page" : "the scene");
        const auto start = std::chrono::steady_clock::now();
        ::kill(process, SIGINT);
        const int status = ::pclose(out);
        goes_on = false;
        trickle.join();
        EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(60));
        EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
    }
}

}  // namespace
}  // namespace gs::test
