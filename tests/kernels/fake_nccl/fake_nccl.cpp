// SPDX-License-Identifier: Apache-2.0
// A library with NCCL's functions, for ranks that are threads of one process and devices that are memory of the host.
// It does its work in threads of its own, as NCCL does without blocking. The environment variable FAKE_NCCL names a
// function that fails, or is "async" for an error that comes later.
#include <nccl.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

/// What all ranks of a connection see.
struct World {
    std::mutex mutex;
    std::condition_variable changed;
    int joined = 0;
    std::map<std::pair<int, int>, std::deque<std::vector<char>>> mail;  ///< by sender and receiver
};

std::mutex worlds_mutex;
std::map<std::string, std::shared_ptr<World>> worlds;  ///< by id
std::atomic<int> next_id = 0, aborts = 0, destroys = 0;

struct Message {
    int peer;
    const void* from;
    void* to;
    std::size_t size;
};
thread_local std::vector<Message> group;
thread_local ncclComm_t comm_of_group = nullptr;

/// Returns whether NCCL would take its time.
bool is_unwanted(const void* address, ncclDataType_t type) {
    return type != ncclInt8 || reinterpret_cast<std::uintptr_t>(address) % 16 != 0;
}

bool fails(const char* function) {
    const char* chosen = std::getenv("FAKE_NCCL");
    return chosen && std::string(chosen) == function;
}

}  // namespace

struct ncclComm {
    std::shared_ptr<World> world;
    int rank = 0;
    std::atomic<ncclResult_t> state = ncclSuccess;
    std::atomic<bool> aborted = false;
    std::thread worker;

    ~ncclComm() {
        if (worker.joinable()) worker.join();
    }
    /// Does work() in a thread, and is busy until then.
    template <class Work> void begin(Work work) {
        if (worker.joinable()) worker.join();
        state = ncclInProgress;
        worker = std::thread([this, work] { state = work(); });
    }
    /// Waits for done() under the world's mutex. Returns false when this rank was aborted first.
    template <class Done> bool wait(std::unique_lock<std::mutex>& lock, Done&& done) {
        world->changed.wait(lock, [&] { return aborted || done(); });
        return !aborted;
    }
    void end() {
        {
            const std::lock_guard lock(world->mutex);
            aborted = true;
        }
        world->changed.notify_all();
    }
};

extern "C" {

/// Counts the connections that were aborted and those that were destroyed in peace.
int fake_nccl_aborts() { return aborts; }
int fake_nccl_destroys() { return destroys; }

ncclResult_t ncclGetVersion(int* version) {
    *version = 29901;
    return fails("ncclGetVersion") ? ncclInternalError : ncclSuccess;
}
const char* ncclGetErrorString(ncclResult_t result) {
    return result == ncclRemoteError ? "remote process exited" : "internal error";
}
const char* ncclGetLastError(ncclComm_t) { return "details of the error"; }

ncclResult_t ncclGetUniqueId(ncclUniqueId* id) {
    std::memset(id, 0, sizeof *id);
    const std::string text = "world " + std::to_string(next_id++);
    std::memcpy(id->internal, text.data(), text.size());
    return fails("ncclGetUniqueId") ? ncclInternalError : ncclSuccess;
}

ncclResult_t ncclCommInitRankConfig(ncclComm_t* comm, int size, ncclUniqueId id, int rank, ncclConfig_t* config) {
    if (config->blocking != 0) return ncclInvalidArgument;
    if (fails("ncclCommInitRankConfig")) return ncclInternalError;
    *comm = new ncclComm;
    (*comm)->rank = rank;
    {
        const std::lock_guard lock(worlds_mutex);
        auto& world = worlds[id.internal];
        if (!world) world = std::make_shared<World>();
        (*comm)->world = world;
    }
    (*comm)->begin([comm = *comm, size] {
        World& world = *comm->world;
        std::unique_lock lock(world.mutex);
        ++world.joined;
        world.changed.notify_all();
        return comm->wait(lock, [&] { return world.joined == size; }) ? ncclSuccess : ncclInternalError;
    });
    return ncclInProgress;
}

ncclResult_t ncclCommGetAsyncError(ncclComm_t comm, ncclResult_t* state) {
    *state = comm->state;
    return ncclSuccess;
}
ncclResult_t ncclCommFinalize(ncclComm_t comm) {
    return comm->state == ncclSuccess ? ncclSuccess : ncclInvalidArgument;
}
ncclResult_t ncclCommDestroy(ncclComm_t comm) {
    ++destroys;
    delete comm;
    return ncclSuccess;
}
ncclResult_t ncclCommAbort(ncclComm_t comm) {
    ++aborts;
    comm->end();
    delete comm;
    return ncclSuccess;
}

ncclResult_t ncclGroupStart() {
    group.clear();
    comm_of_group = nullptr;
    return ncclSuccess;
}
ncclResult_t ncclSend(const void* from, size_t count, ncclDataType_t type, int peer, ncclComm_t comm, cudaStream_t) {
    if (fails("ncclSend") || count == 0 || peer == comm->rank || is_unwanted(from, type)) return ncclInternalError;
    comm_of_group = comm;
    group.push_back({peer, from, nullptr, count});
    return ncclSuccess;
}
ncclResult_t ncclRecv(void* to, size_t count, ncclDataType_t type, int peer, ncclComm_t comm, cudaStream_t) {
    if (fails("ncclRecv") || count == 0 || peer == comm->rank || is_unwanted(to, type)) return ncclInternalError;
    comm_of_group = comm;
    group.push_back({peer, nullptr, to, count});
    return ncclSuccess;
}
ncclResult_t ncclGroupEnd() {
    if (!comm_of_group) return ncclSuccess;
    if (fails("ncclGroupEnd")) return ncclInternalError;
    const bool later = fails("async");
    comm_of_group->begin([comm = comm_of_group, messages = std::move(group), later] {
        World& world = *comm->world;
        std::unique_lock lock(world.mutex);
        for (const Message& m : messages) {
            const char* bytes = static_cast<const char*>(m.from);
            if (bytes) world.mail[{comm->rank, m.peer}].emplace_back(bytes, bytes + m.size);
        }
        world.changed.notify_all();
        if (later) return ncclRemoteError;
        for (const Message& m : messages) {
            if (!m.to) continue;
            auto& box = world.mail[{m.peer, comm->rank}];
            if (!comm->wait(lock, [&] { return !box.empty(); })) return ncclInternalError;
            if (box.front().size() != m.size) return ncclInvalidUsage;
            std::memcpy(m.to, box.front().data(), m.size);
            box.pop_front();
        }
        return ncclSuccess;
    });
    return ncclInProgress;
}

}  // extern "C"
