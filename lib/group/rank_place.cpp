// SPDX-License-Identifier: Apache-2.0
// Reads the environment variables of torchrun and srun, and finds addresses by connecting a datagram socket.
#include "lib/group/rank_place.h"

#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <memory>

#include "kernels/base/error.h"

namespace gs {
namespace {

constexpr int kMostRanks = 4096;
/// The range of ports for jobs that name none: one of ten thousand by the job id, so that jobs on one machine differ.
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

/// Returns the number of tasks on the first machine, from a text like "4(x2),1".
int first_count(const char* text) {
    int value = 1;
    if (text) std::from_chars(text, text + std::char_traits<char>::length(text), value);
    return std::max(1, value);
}

std::string text_of(const sockaddr_storage& address, socklen_t size) {
    char text[NI_MAXHOST] = {};
    ::getnameinfo(reinterpret_cast<const sockaddr*>(&address), size, text, sizeof text, nullptr, 0, NI_NUMERICHOST);
    return text;
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
        // If this variable is set, torchrun's own store listens at MASTER_PORT, so all ranks use the next port.
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

Route route_to(const std::string& host, int port) {
    addrinfo hints{}, *found = nullptr;
    hints.ai_socktype = SOCK_DGRAM;
    if (const int error = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found))
        throw DeviceError(fmt::format("the machine '{}' of rank 0 is not known here: {}", host, ::gai_strerror(error)));
    const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> list(found, &::freeaddrinfo);
    int reason = 0;
    for (const addrinfo* a = found; a; a = a->ai_next) {
        const int socket = ::socket(a->ai_family, a->ai_socktype, a->ai_protocol);
        if (socket < 0) continue;
        sockaddr_storage own{}, other{};
        socklen_t own_size = sizeof own, other_size = sizeof other;
        const bool connected = ::connect(socket, a->ai_addr, a->ai_addrlen) == 0 &&
                               ::getsockname(socket, reinterpret_cast<sockaddr*>(&own), &own_size) == 0 &&
                               ::getpeername(socket, reinterpret_cast<sockaddr*>(&other), &other_size) == 0;
        if (!connected) reason = errno;
        ::close(socket);
        if (connected) return {text_of(own, own_size), text_of(other, other_size)};
    }
    throw DeviceError(fmt::format("no way leads to the machine '{}' of rank 0: {}", host, std::strerror(reason)));
}

}  // namespace gs
