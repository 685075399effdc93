// SPDX-License-Identifier: Apache-2.0
// What torchrun and srun put into the environment, and what goes wrong with it.
#include <gtest/gtest.h>

#include <map>

#include "kernels/base/error.h"
#include "lib/group/rank_place.h"

namespace gs {
namespace {

using Variables = std::map<std::string, std::string>;

std::optional<RankPlace> place(const Variables& variables) {
    return rank_place([&](const char* name) {
        const auto found = variables.find(name);
        return found == variables.end() ? nullptr : found->second.c_str();
    });
}

std::string error_of(const Variables& variables) {
    try {
        place(variables);
    } catch (const UsageError& e) {
        return e.what();
    }
    return "no error";
}

TEST(RankPlace, OfAProcessAloneIsNone) {
    EXPECT_FALSE(place({}));
    EXPECT_FALSE(place({{"WORLD_SIZE", "1"}, {"RANK", "0"}, {"SLURM_STEP_NUM_TASKS", "8"}, {"SLURM_PROCID", "3"}}));
    EXPECT_FALSE(place({{"SLURM_STEP_NUM_TASKS", "1"}}));
    EXPECT_FALSE(place({{"SLURM_NTASKS", "8"}, {"SLURM_PROCID", "0"}})) << "a batch script is no step of srun";
}

TEST(RankPlace, IsWhatTorchrunSays) {
    const auto p = place({{"RANK", "5"},
                          {"WORLD_SIZE", "8"},
                          {"LOCAL_RANK", "1"},
                          {"LOCAL_WORLD_SIZE", "4"},
                          {"MASTER_ADDR", "node7"},
                          {"MASTER_PORT", "29500"}});
    ASSERT_TRUE(p);
    EXPECT_EQ(p->rank, 5);
    EXPECT_EQ(p->size, 8);
    EXPECT_EQ(p->local_rank, 1);
    EXPECT_EQ(p->local_size, 4);
    EXPECT_EQ(p->master, "node7");
    EXPECT_EQ(p->port, 29500);
    const auto beside_store = [](const char* port) {
        return place({{"RANK", "1"},
                      {"WORLD_SIZE", "2"},
                      {"MASTER_ADDR", "node7"},
                      {"MASTER_PORT", port},
                      {"TORCHELASTIC_USE_AGENT_STORE", "True"}})
            ->port;
    };
    EXPECT_EQ(beside_store("29500"), 29501) << "torchrun's own store listens at the port that it names";
    EXPECT_EQ(beside_store("65535"), 65534);
    EXPECT_EQ(p->port, 29500);
}

TEST(RankPlace, IsWhatSrunSays) {
    Variables slurm = {{"SLURM_STEP_NUM_TASKS", "6"},
                       {"SLURM_PROCID", "4"},
                       {"SLURM_LOCALID", "0"},
                       {"SLURM_STEP_TASKS_PER_NODE", "4,2"},
                       {"SLURM_STEP_NODELIST", "gpu[03-04]"},
                       {"SLURM_JOB_ID", "1234567"}};
    auto p = place(slurm);
    ASSERT_TRUE(p);
    EXPECT_EQ(p->rank, 4);
    EXPECT_EQ(p->size, 6);
    EXPECT_EQ(p->local_size, 4);
    EXPECT_EQ(p->master, "gpu03");
    EXPECT_EQ(p->port, 24567);
    slurm["MASTER_ADDR"] = "10.0.0.7", slurm["MASTER_PORT"] = "4000";
    p = place(slurm);
    EXPECT_EQ(p->master, "10.0.0.7");
    EXPECT_EQ(p->port, 4000);
}

TEST(RankPlace, NamesVariableAndValueOfAMistake) {
    const Variables good = {{"RANK", "1"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "1"}};
    const auto with = [&](const std::string& name, const std::string& value) {
        Variables changed = good;
        changed[name] = value;
        if (value.empty()) changed.erase(name);
        return error_of(changed);
    };
    EXPECT_EQ(error_of(good), "no error");
    EXPECT_NE(with("WORLD_SIZE", "two").find("WORLD_SIZE: 'two'"), std::string::npos);
    EXPECT_NE(with("WORLD_SIZE", "0").find("WORLD_SIZE: '0'"), std::string::npos);
    EXPECT_NE(with("RANK", "2").find("RANK: 2 is not below"), std::string::npos);
    EXPECT_NE(with("RANK", "-1").find("RANK: '-1'"), std::string::npos);
    EXPECT_NE(with("RANK", "").find("RANK is missing"), std::string::npos);
    EXPECT_NE(with("MASTER_ADDR", "").find("MASTER_ADDR is missing"), std::string::npos);
    EXPECT_NE(with("MASTER_PORT", "70000").find("MASTER_PORT: '70000'"), std::string::npos);
    EXPECT_NE(error_of({{"SLURM_STEP_NUM_TASKS", "2"}, {"SLURM_PROCID", "0"}}).find("MASTER_ADDR"), std::string::npos);
}

TEST(RankPlace, FirstMachineOfAList) {
    EXPECT_EQ(first_of_node_list("gpu1"), "gpu1");
    EXPECT_EQ(first_of_node_list("gpu1,gpu2"), "gpu1");
    EXPECT_EQ(first_of_node_list("node[03-07,9],gpu1"), "node03");
    EXPECT_EQ(first_of_node_list("a[5,7]"), "a5");
    EXPECT_EQ(first_of_node_list("login,node[03-07]"), "login");
    EXPECT_EQ(first_of_node_list("a["), "a");
    EXPECT_EQ(first_of_node_list(""), "");
}

}  // namespace
}  // namespace gs
