// SPDX-License-Identifier: Apache-2.0
// A run of one appearance is not resumed as another.
#include <gtest/gtest.h>

#include "appearance/model_info.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

constexpr const char* kTrain = "train -s builtin:diffuse --device cpu -r 8 --iterations 1 ";

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
        ASSERT_EQ(program.run(kTrain + ("-m " + held + " --appearance " + held)).exit_code, 0) << held;
        expect_refusal(program, held, "--appearance " + asked, held + ",", asked + ",");
    }
}

TEST(Resume, AnotherDegreeOrActivationIsRefused) {
    const Program program;
    ASSERT_EQ(program.run(std::string(kTrain) + "-m run").exit_code, 0);
    expect_refusal(program, "run", "--sh-degree 2", "sh, max degree 3, relu)", "sh, max degree 2, relu)");
    expect_refusal(program, "run", "--color-activation softplus", "sh, max degree 3, relu)",
                   "sh, max degree 3, softplus)");
    expect_refusal(program, "run", "--color-activation softplus --overwrite", "sh, max degree 3, relu)",
                   "sh, max degree 3, softplus)");
    EXPECT_EQ(program.run("train -m run --resume latest --iterations 2").exit_code, 0)
        << "and as what it is it goes on";
}

}  // namespace
}  // namespace gs
