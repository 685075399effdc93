// SPDX-License-Identifier: Apache-2.0
// Short trainings through the program: files, progress lines, resuming, interrupting, a chosen appearance.
#include <gtest/gtest.h>
#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>

#include "appearance/model_info.h"
#include "lib/core/json_text.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

std::vector<nlohmann::json> json_lines(const std::string& text) {
    std::vector<nlohmann::json> lines;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) lines.push_back(parse_json(line));
    return lines;
}

constexpr const char* kShort =
    "train -s builtin:diffuse --device cpu --eval -r 8 --iterations 20 --init-points 400 --cap-max 600 ";

TEST(Train, BeginsWithTheModelOfAnotherRun) {
    const Program program;
    const std::string train = "train -s builtin:diffuse -r 8 --device cpu --eval ";
    ASSERT_EQ(program.run(train + "--appearance sh --iterations 120 -m first").exit_code, 0);
    const auto loss = [&](const std::string& run) {  // after a hundred iterations
        for (const nlohmann::json& line : json_lines(program.read(run + "/stats/train.jsonl")))
            if (line["event"] == "step") return line["loss"].get<double>();
        return 1e9;
    };
    ASSERT_EQ(program.run(train + "--appearance sh --iterations 100 -m afresh").exit_code, 0);
    const Outcome again = program.run(train + "--appearance sh --iterations 100 -m again --init first");
    ASSERT_EQ(again.exit_code, 0) << again.err;
    EXPECT_NE(again.err.find("with their residuals"), std::string::npos) << again.err;
    EXPECT_LT(loss("again"), loss("afresh"));
    const Outcome other = program.run(train + "--appearance nasg --iterations 2 -m other --init first");
    ASSERT_EQ(other.exit_code, 0) << other.err;
    EXPECT_NE(other.err.find("residuals begin at 0"), std::string::npos) << other.err;
    const Outcome resume = program.run(train + "--resume first/point_cloud/iteration_120/point_cloud.ply -m no");
    EXPECT_EQ(resume.exit_code, 2);
    EXPECT_NE(resume.err.find("--init"), std::string::npos) << resume.err;
    EXPECT_EQ(program.run(train + "--init nowhere -m no").exit_code, 2);
    // What cannot be read costs no earlier run; and a run may begin with the one that it replaces.
    EXPECT_EQ(program.run(train + "--init nowhere -m first --overwrite").exit_code, 2);
    const Outcome itself = program.run(train + "--appearance sh --iterations 2 -m first --init first --overwrite");
    EXPECT_EQ(itself.exit_code, 0) << itself.err;
    EXPECT_NE(itself.err.find("with their residuals"), std::string::npos) << itself.err;
}

TEST(Train, LeavesTheDocumentedRunFolder) {
    const Program program;
    const Outcome outcome = program.run(std::string(kShort) + "-m run --test-iterations 10");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    for (const char* name :
         {"config.yaml", "cfg_args", "cameras.json", "input.ply", "point_cloud/iteration_20/point_cloud.ply",
          "checkpoints/iteration_20.safetensors", "stats/train.jsonl", "results.json", "per_view.json",
          "test/ours_20/renders/00000.png", "test/ours_20/gt/00000.png", "comparison.png", "gsapp.log"}) {
        EXPECT_TRUE(std::filesystem::exists(program.path("run") / name)) << name;
    }
    EXPECT_FALSE(std::filesystem::exists(program.path("run/test/ours_10"))) << "pictures are for the last iteration";
    for (const char* line : {"point cloud: run/point_cloud/iteration_20/point_cloud.ply",
                             "look at it with: gsapp view run; make a web page of it with: gsapp export run -o DIR"})
        EXPECT_NE(outcome.err.find(line), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("device: "), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("device: "), outcome.err.rfind("device: ")) << "said once: " << outcome.err;
    const auto results = parse_json(program.read("run/results.json"));
    EXPECT_TRUE(results.contains("ours_10"));
    EXPECT_GT(results["ours_20"]["PSNR"], 5.0);
    EXPECT_GT(results["timing"]["ours_20"]["train_seconds"], 0.0);
}

TEST(Train, LimitsArePlannedAndReported) {
    const Program program;
    const std::string common = "train -s builtin:diffuse --device cpu --eval -r 4 --appearance none ";
    const Outcome outcome = program.run(common + "-m run --time-limit 2s --size-limit 200KB --size-of ply --json");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_NE(outcome.err.find("(--size-limit), 2.0 s, by estimate"), std::string::npos) << outcome.err;
    const std::string log = program.read("run/gsapp.log");
    EXPECT_NE(log.find("at most 100000 Gaussians, as for every built-in scene; --cap-max names another number"),
              std::string::npos)
        << log;
    EXPECT_NE(log.find("plan: time: 2.0 s"), std::string::npos) << log;
    EXPECT_NE(log.find("plan: size: at most 200KB as ply"), std::string::npos) << log;
    double left = 2;
    std::istringstream lines(outcome.out);
    for (std::string line; std::getline(lines, line);) {
        const auto event = parse_json(line);
        if (event["event"] != "progress") continue;
        EXPECT_LE(event["eta_seconds"], left) << "the time that is left";
        EXPECT_TRUE(event["iterations"].is_null() || event["iterations"] == event["iteration"]) << line;
        left = event["eta_seconds"];
    }
    EXPECT_LT(left, 2) << outcome.out;
    const auto results = parse_json(program.read("run/results.json"));
    const auto plan = results["plan"].begin().value();
    EXPECT_EQ(plan["time"]["limit_seconds"], 2.0);
    EXPECT_GT(plan["time"]["seconds"], 1.0);
    EXPECT_LE(plan["size"]["bytes"], 200000);
    const std::string iteration = results["plan"].begin().key().substr(5);
    EXPECT_LE(std::filesystem::file_size(program.path("run/point_cloud/iteration_" + iteration + "/point_cloud.ply")),
              200000u);
    EXPECT_EQ(program.run("eval run --skip-render").exit_code, 0);
    for (const char* wrong :
         {"--time-limit 0", "--time-limit soon", "--time-limit -5s", "--time-limit 5", "--time-limit 0.001s",
          "--size-limit 10", "--size-limit -1MB", "--preset fast --time-limit 5s"}) {
        const Outcome refused = program.run(common + "-m other " + wrong);
        EXPECT_EQ(refused.exit_code, 2) << wrong << refused.err;
        EXPECT_FALSE(std::filesystem::exists(program.path("other/point_cloud"))) << wrong;
    }
}

TEST(Train, TheEstimateComparesWithMoreGaussiansOnly) {
    const Program program;
    // The scene's 5000 points stay, also where --cap-max is below them.
    const std::string common = "train -s builtin:diffuse --device cpu --eval --preset fast --iterations 20 ";
    const Outcome enough = program.run(common + "-r 8 --cap-max 100 -m enough");
    ASSERT_EQ(enough.exit_code, 0) << enough.err;
    EXPECT_NE(enough.err.find("iterations are more than 10 dB below a training of any length (more --iterations come "
                              "closer)"),
              std::string::npos)
        << enough.err;
    EXPECT_EQ(enough.err.find("Gaussians are "), std::string::npos) << "no number is below itself\n" << enough.err;
    const Outcome few = program.run(common + "-r 2 --cap-max 9000 -m few");
    ASSERT_EQ(few.exit_code, 0) << few.err;
    EXPECT_NE(few.err.find(" dB below 9000 (--cap-max); a training of more --iterations lets more grow"),
              std::string::npos)
        << few.err;
}

TEST(Render, DecomposeWritesFullBaseAndResidual) {
    const Program program;
    // SV's residual is active from the start.
    ASSERT_EQ(program.run(std::string(kShort) + "-m run --appearance sv").exit_code, 0);
    const Outcome rendered = program.run("render run --orbit 2 --decompose -o out");
    ASSERT_EQ(rendered.exit_code, 0) << rendered.err;
    for (const char* part : {"full", "base", "residual"}) {
        EXPECT_TRUE(std::filesystem::exists(program.path("out") / part / "00000.png")) << part;
        EXPECT_TRUE(std::filesystem::exists(program.path("out") / part / "00001.png")) << part;
    }
    EXPECT_FALSE(std::filesystem::exists(program.path("out/00000.png")));
    const Outcome scored = program.run("eval run --decompose");
    ASSERT_EQ(scored.exit_code, 0) << scored.err;
    for (const char* part : {"renders", "gt", "base", "residual"})
        EXPECT_TRUE(std::filesystem::exists(program.path("run/test/ours_20") / part / "00000.png")) << part;
    const auto results = parse_json(program.read("run/results.json"));
    EXPECT_GT(results["decomposition"]["ours_20"]["residual_mean"], 0.0);
    EXPECT_LT(results["decomposition"]["ours_20"]["residual_mean"], 1.0);
    EXPECT_EQ(program.run("eval run --decompose --skip-render").exit_code, 2);
}

TEST(Train, WithJsonStdoutIsJsonLines) {
    const Program program;
    const Outcome outcome = program.run(std::string(kShort) + "-m run --json");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const auto lines = json_lines(outcome.out);
    ASSERT_GE(lines.size(), 3u);
    EXPECT_EQ(lines.front()["event"], "progress");
    EXPECT_EQ(lines[lines.size() - 2]["event"], "evaluation");
    EXPECT_EQ(lines.back()["event"], "finished");
    EXPECT_EQ(lines.back()["iteration"], 20);
    EXPECT_NE(outcome.err.find("| run |"), std::string::npos) << "the table is for people\n" << outcome.err;
}

TEST(Train, WithoutATerminalStdoutIsTheTableAlone) {
    const Program program;
    const Outcome outcome = program.run(std::string(kShort) + "-m run");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_TRUE(outcome.out.starts_with("### diffuse (builtin)\n")) << outcome.out;
    EXPECT_EQ(outcome.out.find("{"), std::string::npos) << outcome.out;
    EXPECT_EQ(outcome.err.find("| run |"), std::string::npos) << outcome.err;
}

TEST(Train, ThreeLinesOpenIt) {
    const Program program;
    const std::string train = "train -s builtin:diffuse --device cpu --eval -r 8 --iterations 20 --cap-max 6000 ";
    const Outcome outcome = program.run(train + "-m run");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    std::istringstream lines(outcome.err.substr(0, outcome.err.find("info: iteration 20: PSNR")));
    std::vector<std::string> opening;
    for (std::string line; std::getline(lines, line);) opening.push_back(line);
    ASSERT_EQ(opening.size(), 3u) << outcome.err;
    EXPECT_TRUE(opening[0].starts_with("info: builtin:diffuse: 40 training views, 8 test views (")) << opening[0];
    EXPECT_EQ(opening[1], "info: training sh, at most 6000 Gaussians (--cap-max), 20 iterations, into run");
    EXPECT_TRUE(opening[2].starts_with("info: device: CPU")) << opening[2];
    EXPECT_NE(program.read("run/gsapp.log").find("debug: memory plan: "), std::string::npos) << "the log has the rest";
    const Outcome verbose = program.run(train + "-m verbose -v");
    EXPECT_NE(verbose.err.find("debug: memory plan: "), std::string::npos) << verbose.err;
}

TEST(Train, HoursOnTheCpuAreSaidAtTheStart) {
    const Program program;
    const Outcome stopped =
        program.interrupt("train -s builtin:diffuse --device cpu -r 8 --iterations 100000000 -m run", "on the CPU, by");
    ASSERT_EQ(stopped.exit_code, 130) << stopped.err;
    const auto at = stopped.err.find("warning: this training takes about ");
    ASSERT_NE(at, std::string::npos) << stopped.err;
    for (const char* option : {"--time-limit 10m", "-r 4", "--iterations", "--cap-max"})
        EXPECT_NE(stopped.err.find(option, at), std::string::npos) << stopped.err;
}

TEST(Train, QuietPrintsOnlyTheTable) {
    const Program program;
    const Outcome outcome = program.run(std::string(kShort) + "-m run --quiet");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.out.find("{"), std::string::npos) << outcome.out;
    EXPECT_NE(outcome.out.find("PSNR"), std::string::npos) << outcome.out;
    EXPECT_EQ(outcome.err.find("info"), std::string::npos) << outcome.err;
}

TEST(Train, FolderIsChosenWhenNoneIsGiven) {
    const Program program;
    ASSERT_EQ(program.run("train builtin:diffuse -r 4 --iterations 1").exit_code, 0);
    ASSERT_EQ(program.run("train builtin:diffuse -r 4 --iterations 1 --appearance none").exit_code, 0);
    ASSERT_EQ(program.run("train builtin:diffuse -r 4 --iterations 1").exit_code, 0);
    for (const char* name : {"diffuse-sh-1", "diffuse-none-1", "diffuse-sh-2"}) {
        EXPECT_TRUE(std::filesystem::exists(program.path("output") / name / "config.yaml")) << name;
    }
}

TEST(Train, StoredConfigurationRepeatsTheRun) {
    const Program program;
    const Outcome first = program.run(std::string(kShort) + "-m a --opacity-lr auto");
    ASSERT_EQ(first.exit_code, 0) << first.err;
    EXPECT_NE(program.read("a/gsapp.log").find("opacity-lr auto: 0.0"), std::string::npos)
        << "the number that was chosen";
    EXPECT_NE(program.read("a/config.yaml").find("opacity-lr: auto\n"), std::string::npos);
    const Outcome again = program.run("train -c a/config.yaml -m b");
    ASSERT_EQ(again.exit_code, 0) << again.err;
    const std::string ply = "/point_cloud/iteration_20/point_cloud.ply";
    ASSERT_FALSE(program.read("a" + ply).empty());
    EXPECT_EQ(program.read("a" + ply), program.read("b" + ply));
}

TEST(Train, InterruptWritesACheckpointThatResumes) {
    const Program program;
    const Outcome stopped =
        program.interrupt("train -s builtin:diffuse -r 4 --iterations 1000000 -m run --json", "\"progress\"");
    ASSERT_EQ(stopped.exit_code, 130) << stopped.err;
    std::int64_t iteration = 0;
    for (const auto& entry : std::filesystem::directory_iterator(program.path("run/checkpoints"))) {
        const std::string stem = entry.path().stem().string();
        iteration = std::stoll(stem.substr(stem.rfind('_') + 1));
    }
    ASSERT_GT(iteration, 0) << stopped.err;
    const std::string total = std::to_string(iteration + 5);
    const Outcome resumed = program.run("train -m run --resume --json --iterations " + total);
    ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
    EXPECT_EQ(json_lines(resumed.out).back()["iteration"], iteration + 5);
    EXPECT_TRUE(std::filesystem::exists(program.path("run/point_cloud/iteration_" + total + "/point_cloud.ply")));
}

TEST(Train, InterruptedControllersAreTrainedAnewByTheResumedRun) {
    const Program program;
    const Outcome stopped = program.interrupt(
        "train -s builtin:exposure --device cpu --eval -r 8 --iterations 5 --ppisp on --controller-iterations 1000000 "
        "-m run --json",
        "\"stage\":\"controller\"");
    ASSERT_EQ(stopped.exit_code, 130) << stopped.err;
    EXPECT_NE(stopped.err.find("iterations of the controllers, which are lost"), std::string::npos) << stopped.err;
    const Outcome neutral = program.run("eval run");
    ASSERT_EQ(neutral.exit_code, 0) << neutral.err;
    EXPECT_NE(neutral.out.find("| none "), std::string::npos) << neutral.out;
    EXPECT_EQ(program.run("eval run --ppisp-eval controller").exit_code, 2);
    const Outcome resumed = program.run("train -m run --resume --json --controller-iterations 3");
    ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
    const auto lines = json_lines(resumed.out);
    EXPECT_EQ(lines.back()["event"], "finished");
    EXPECT_GT(lines.back()["controller_seconds"], 0.0);
    EXPECT_TRUE(std::any_of(lines.begin(), lines.end(), [](const auto& line) {
        return line.value("stage", "") == "controller";
    })) << resumed.out;
    const Outcome controlled = program.run("eval run");
    ASSERT_EQ(controlled.exit_code, 0) << controlled.err;
    EXPECT_NE(controlled.out.find("| controller "), std::string::npos) << controlled.out;
    EXPECT_EQ(program.run("render run --orbit 1 -o pictures").exit_code, 0);
    const Outcome own = program.run("eval run --source builtin:polished --ppisp-eval scene-aligned");
    ASSERT_EQ(own.exit_code, 0) << own.err;
    EXPECT_NE(own.out.find("| scene-aligned "), std::string::npos) << own.out;
    EXPECT_TRUE(std::filesystem::exists(program.path("run/on-polished/results.json")));
}

// A run of one appearance is not resumed as another.

constexpr const char* kOneStep = "train -s builtin:diffuse --device cpu -r 8 --iterations 1 --init-points 300 ";

/// Resumes the run in `folder` with other appearance options, which has to be refused in words that name file and both
/// models.
void expect_refusal(const Program& program, const std::string& folder, const std::string& options,
                    const std::string& held, const std::string& asked) {
    const std::string file = folder + "/checkpoints/iteration_1.safetensors", before = program.read(file),
                      config = program.read(folder + "/config.yaml");
    const Outcome outcome = program.run("train -m " + folder + " --resume latest --iterations 2 " + options);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    for (const std::string& part : {file, "(" + held, "(" + asked})
        EXPECT_NE(outcome.err.find(part), std::string::npos) << part << " is not in\n" << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(program.read(file), before);
    EXPECT_EQ(program.read(folder + "/config.yaml"), config);
}

TEST(Resume, AnotherModelIsRefused) {
    const Program program;
    // In a ring: every model is once the one in the file and once the one asked for.
    const auto& models = appearance_models();
    for (std::size_t k = 0; k < models.size(); ++k) {
        const std::string held = models[k]->name, asked = models[(k + 1) % models.size()]->name;
        ASSERT_EQ(program.run(kOneStep + ("-m " + held + " --appearance " + held)).exit_code, 0) << held;
        expect_refusal(program, held, "--appearance " + asked, held + ",", asked + ",");
    }
}

TEST(Resume, AnotherDegreeOrActivationIsRefused) {
    const Program program;
    ASSERT_EQ(program.run(std::string(kOneStep) + "-m run").exit_code, 0);
    expect_refusal(program, "run", "--sh-degree 2", "sh, max degree 3, relu)", "sh, max degree 2, relu)");
    expect_refusal(program, "run", "--color-activation softplus", "sh, max degree 3, relu)",
                   "sh, max degree 3, softplus)");
    expect_refusal(program, "run", "--color-activation softplus --overwrite", "sh, max degree 3, relu)",
                   "sh, max degree 3, softplus)");
    EXPECT_EQ(program.run("train -m run --resume latest --iterations 2").exit_code, 0)
        << "and as what it is it goes on";
}

// `gsapp train --appearance auto` as a user calls it.

constexpr const char* kAuto = "train -s builtin:glossy --device cpu -r 16 --eval --init-points 500 --cap-max 500 ";

TEST(AutoAppearance, TrainsTheChosenModelAsIfItHadBeenNamed) {
    const Program program;
    const Outcome chosen = program.run(std::string(kAuto) + "--iterations 150 --appearance auto -m chosen");
    ASSERT_EQ(chosen.exit_code, 0) << chosen.err;
    const auto choice = parse_json(program.read("chosen/auto.json"));
    const std::string model = choice["model"];
    // So short a run ranks nothing; tests/eval/auto has what longer ones do.
    EXPECT_EQ(model, "sv");
    EXPECT_EQ(choice["lines"].size(), 1u);
    EXPECT_NE(chosen.err.find("too short to tell"), std::string::npos) << chosen.err;
    EXPECT_GT(choice["share_of_training"], 0.0);
    EXPECT_NE(program.read("chosen/config.yaml").find("appearance: " + model), std::string::npos);
    EXPECT_EQ(parse_json(program.read("chosen/results.json"))["appearance_choice"]["ours_150"]["model"], model);
    ASSERT_EQ(program.run(std::string(kAuto) + "--iterations 150 --appearance " + model + " -m named").exit_code, 0);
    EXPECT_FALSE(std::filesystem::exists(program.path("named/auto.json")));
    const std::string ply = "/point_cloud/iteration_150/point_cloud.ply";
    EXPECT_EQ(program.read("chosen" + ply), program.read("named" + ply))
        << "the choice leaves nothing behind in the training";
}

TEST(AutoAppearance, AResumedRunDoesNotDecideAgain) {
    const Program program;
    ASSERT_EQ(program.run(std::string(kAuto) + "--iterations 100 --appearance auto -m run").exit_code, 0);
    // The share of the training is that of the whole run, which has become longer.
    const auto decision = [&] {
        const std::string choice = program.read("run/auto.json");
        return choice.substr(0, choice.find("share_of_training"));
    };
    const std::string first = decision();
    EXPECT_GT(first.size(), 100u);
    for (const char* resume : {"train -m run --resume latest --iterations 101",
                               "train -m run --resume latest --iterations 102 --appearance auto"}) {
        const Outcome resumed = program.run(resume);
        ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
        EXPECT_EQ(resumed.err.find("--appearance auto: "), std::string::npos) << resumed.err;
        EXPECT_EQ(decision(), first);
    }
}

TEST(AutoAppearance, IsRefusedWhereRunsAreCompared) {
    const Program program;
    for (const char* command :
         {"train --eval --runs 2 --appearance auto", "bench suite densification --appearances sh,auto",
          "tradeoff --axes appearance=none,auto", "tradeoff --axes budget --appearance auto"}) {
        const Outcome outcome = program.run(std::string(command) + " -s builtin:diffuse --device cpu -r 8 -m out");
        EXPECT_EQ(outcome.exit_code, 2) << command;
        EXPECT_NE(outcome.err.find("appearance auto: every run that is compared"), std::string::npos) << command << "\n"
                                                                                                      << outcome.err;
        EXPECT_FALSE(std::filesystem::exists(program.path("out"))) << command;
    }
}

}  // namespace
}  // namespace gs
