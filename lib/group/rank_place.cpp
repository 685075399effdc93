// SPDX-License-Identifier: Apache-2.0
// Reads what torchrun and srun put into the environment.
#include "lib/group/rank_place.h"

#include <fmt/format.h>

#include <charconv>

#include "kernels/base/error.h"

namespace gs {
namespace {

constexpr int kMostRanks = 4096;
/// Ports for jobs that name none: one of ten thousand by the number of the job, so that jobs on one machine differ.
constexpr int kFirstPort = 20000, kPorts = 10000;

std::optional<int> number(const Environment& variable, const char* name, int least, int most) {
    const char* text = variable(name);
    if (!text) return std::nullopt;
    int value = 0;
    const std::string all = text;
    const auto [end, error] = std::from_chars(all.data(), all.data() + all.size(), value);
    if (error != std::errc() || end != all.data() + all.size() || value < least || value > most)
        throw UsageError(
            fmt::format("environment variable {}: '{}' is no number from {} to {}", name, all, least, most));
    return value;
}

int required(const Environment& variable, const char* name, int least, int most, const char* because) {
    if (const auto value = number(variable, name, least, most)) return *value;
    throw UsageError(fmt::format("environment variable {} is missing, although {} is set", name, because));
}

void check_rank(int rank, int size, const char* rank_name, const char* size_name) {
    if (rank >= size)
        throw UsageError(
            fmt::format("environment variable {}: {} is not below {}, which is {}", rank_name, rank, size_name, size));
}

/// Returns the tasks on the first machine of "4(x2),1".
int first_count(const char* text) {
    int value = 1;
    if (text) std::from_chars(text, text + std::char_traits<char>::length(text), value);
    return std::max(1, value);
}

}  // namespace

std::string first_of_node_list(const std::string& list) {
    const std::size_t bracket = list.find('['), comma = list.find(',');
    if (bracket == std::string::npos || comma < bracket) return list.substr(0, comma);
    const std::size_t end = list.find_first_of("-,]", bracket);
    return list.substr(0, bracket) + list.substr(bracket + 1, end == std::string::npos ? end : end - bracket - 1);
}

std::optional<RankPlace> rank_place(const Environment& variable) {
    RankPlace place;
    if (const auto size = number(variable, "WORLD_SIZE", 1, kMostRanks)) {
        if (*size == 1) return std::nullopt;
        place.size = *size;
        place.rank = required(variable, "RANK", 0, kMostRanks, "WORLD_SIZE");
        check_rank(place.rank, place.size, "RANK", "WORLD_SIZE");
        place.local_rank = number(variable, "LOCAL_RANK", 0, kMostRanks).value_or(0);
        place.local_size = number(variable, "LOCAL_WORLD_SIZE", 1, kMostRanks).value_or(place.local_rank + 1);
        if (!variable("MASTER_ADDR"))
            throw UsageError("environment variable MASTER_ADDR is missing, although WORLD_SIZE is set");
        place.port = required(variable, "MASTER_PORT", 1, 65535, "WORLD_SIZE");
        // Where torchrun says so, a store of its own listens at MASTER_PORT. All ranks take the next one.
        if (const char* taken = variable("TORCHELASTIC_USE_AGENT_STORE"); taken && std::string(taken) == "True")
            place.port += place.port < 65535 ? 1 : -1;
    } else if (const auto tasks = number(variable, "SLURM_STEP_NUM_TASKS", 1, kMostRanks); tasks.value_or(1) > 1) {
        place.size = *tasks;
        place.rank = required(variable, "SLURM_PROCID", 0, kMostRanks, "SLURM_STEP_NUM_TASKS");
        check_rank(place.rank, place.size, "SLURM_PROCID", "SLURM_STEP_NUM_TASKS");
        place.local_rank = number(variable, "SLURM_LOCALID", 0, kMostRanks).value_or(0);
        place.local_size = first_count(variable("SLURM_STEP_TASKS_PER_NODE"));
        const int job = number(variable, "SLURM_JOB_ID", 0, 2147483647).value_or(0);
        place.port = number(variable, "MASTER_PORT", 1, 65535).value_or(kFirstPort + job % kPorts);
        if (const char* nodes = variable("SLURM_STEP_NODELIST")) place.master = first_of_node_list(nodes);
    } else {
        return std::nullopt;
    }
    if (const char* master = variable("MASTER_ADDR")) place.master = master;
    if (place.master.empty())
        throw UsageError("environment variable MASTER_ADDR: nothing says on which machine rank 0 is");
    return place;
}

}  // namespace gs
