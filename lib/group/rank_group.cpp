// SPDX-License-Identifier: Apache-2.0
// Starts the other ranks of one machine, watches all ranks in a separate thread, and aborts communication if one is
// lost.
#include "lib/group/rank_group.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <mutex>
#include <new>
#include <sstream>
#include <thread>
#include <utility>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/ranks/connect_devices.h"
#include "kernels/ranks/message.h"
#include "kernels/ranks/socket_communicator.h"
#include "lib/core/interrupt.h"
#include "lib/core/process.h"
#include "lib/group/rank_port.h"
#include "lib/group/secret.h"

namespace gs {
namespace {

constexpr const char* kParent = "GSAPP_RANK_PARENT";
/// The time allowed for ranks to end by themselves.
constexpr std::chrono::seconds kLastWords(5);

/// Returns the command line of this process.
std::vector<std::string> own_arguments() {
    std::ifstream file("/proc/self/cmdline", std::ios::binary);
    const std::string all((std::istreambuf_iterator<char>(file)), {});
    std::vector<std::string> arguments;
    for (std::size_t at = 0; at < all.size(); at += arguments.back().size() + 1) arguments.emplace_back(&all[at]);
    if (arguments.empty()) throw Error(ExitCode::kUnexpected, "cannot read /proc/self/cmdline to start more ranks");
    return arguments;
}

using std::chrono::milliseconds;

/// The intervals between two checks of this machine's processes, and between two reports to rank 0.
constexpr milliseconds kLook(100), kReport(1000);
/// The seconds that an error waits for its reason, since a connection may break before the reason is known.
constexpr double kWaitForReason = 3;
/// The seconds that a rank waits for the connection of another before it checks for a failure.
constexpr double kLookForRank = 0.1;
/// The time that a rank may continue its work after its connection was aborted.
constexpr milliseconds kMostDelay(10000);

const char* environment(const char* name) { return std::getenv(name); }

std::string host_name() {
    char name[256] = {};
    ::gethostname(name, sizeof name - 1);
    return name;
}

/// Returns the text that distinguishes a job from others at the same port.
std::string job_of(const std::string& work, int size) {
    std::string job = fmt::format("{} ranks: {}", size, work);
    for (const char* name : {"SLURM_JOB_ID", "SLURM_STEP_ID", "TORCHELASTIC_RUN_ID"})
        if (const char* value = environment(name)) job += fmt::format("\n{} {}", name, value);
    return job;
}

/// A communicator that replaces the message of a connection error by its reason, if known.
class ExplainingCommunicator final : public Communicator {
  public:
    ExplainingCommunicator(std::unique_ptr<Communicator> connection, std::function<std::string()> reason)
        : Communicator(connection->rank(), connection->size()),
          connection_(std::move(connection)),
          reason_(std::move(reason)) {}

  private:
    void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) override {
        try {
            connection_->exchange(out, in);
        } catch (const DeviceError& e) {
            const std::string reason = reason_();
            if (!reason.empty()) throw DeviceError(reason);
            throw DeviceError(rank() == 0 ? e.what() : "the connection to rank 0 was lost");
        }
    }
    void transfer_on_device(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in,
                            DeviceStream& device) override {
        explaining([&] { Communicator::transfer_on_device(out, in, device); });
    }
    void finish_on_device() override {
        explaining([&] { Communicator::finish_on_device(); });
    }
    template <class Fn> void explaining(Fn&& transfer) {
        try {
            transfer();
        } catch (const DeviceError& e) {  // error of the link, or of this rank's own device
            const std::string reason = reason_();
            throw DeviceError(reason.empty() ? e.what() : reason);
        }
    }
    void break_off() override { connection_->abort(); }

    const std::unique_ptr<Communicator> connection_;
    const std::function<std::string()> reason_;
};

}  // namespace

LocalRanks::LocalRanks(int size, int port, const std::string& secret) {
    const std::vector<std::string> arguments = own_arguments();
    const std::string size_text = std::to_string(size);
    for (int rank = 1; rank < size; ++rank) {
        const std::string rank_text = std::to_string(rank);
        processes_.push_back({rank, start_process("/proc/self/exe", arguments,
                                                  {{"RANK", rank_text},
                                                   {"WORLD_SIZE", size_text},
                                                   {"LOCAL_RANK", rank_text},
                                                   {"LOCAL_WORLD_SIZE", size_text},
                                                   {"MASTER_ADDR", "127.0.0.1"},
                                                   {"MASTER_PORT", std::to_string(port)},
                                                   {"TORCHELASTIC_USE_AGENT_STORE", "False"},
                                                   {kSecretVariable, secret},
                                                   {kParent, std::to_string(::getpid())}})});
    }
}

LocalRanks::~LocalRanks() {
    const auto end = std::chrono::steady_clock::now() + kLastWords;
    for (Process& process : processes_)
        while (process.running && std::chrono::steady_clock::now() < end) {
            process.running = ::waitpid(process.pid, nullptr, WNOHANG) == 0;
            if (process.running) std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
    kill();
}

void LocalRanks::kill() {
    for (Process& process : processes_) {
        if (!process.running) continue;
        ::kill(process.pid, SIGKILL);
        ::waitpid(process.pid, nullptr, 0);
        process.running = false;
    }
}

std::optional<std::string> LocalRanks::first_lost() {
    for (Process& process : processes_) {
        int status = 0;
        if (!process.running || ::waitpid(process.pid, &status, WNOHANG) <= 0) continue;
        process.running = false;
        if (WIFSIGNALED(status))
            return fmt::format("rank {} was ended by signal {} ({}){}", process.rank, WTERMSIG(status),
                               ::strsignal(WTERMSIG(status)),
                               WTERMSIG(status) == SIGKILL ? "; perhaps memory ran out" : "");
        return fmt::format("rank {} ended with exit code {}", process.rank, WEXITSTATUS(status));
    }
    return std::nullopt;
}

void end_with_rank_0() {
    const char* parent = ::getenv(kParent);
    if (!parent) return;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (std::to_string(::getppid()) != parent) ::_exit(int(ExitCode::kUnexpected));  // the parent has already ended
}

struct RankGroup::Implementation {
    RankPlace place;
    Credentials credentials;
    std::optional<Roster> roster;  ///< set on rank 0
    std::optional<RankPort> port;  ///< set on rank 0 for its lifetime, on others while ranks connect
    std::optional<LocalRanks> processes;
    std::optional<RosterClient> client;  ///< set on ranks other than 0
    std::mutex mutex;
    std::condition_variable ending_changed;
    bool ending = false;
    std::string failure;  ///< on ranks other than 0: failure reported by rank 0, or why it cannot be reached
    std::unique_ptr<Communicator> communicator;
    bool asked_devices = false;  ///< whether connect_devices() was called
    std::thread watch;

    std::string reason() {
        if (roster) return roster->failure();
        const std::lock_guard lock(mutex);
        return failure;
    }
    /// Waits up to kWaitForReason for the reason of an error, and returns it; empty if none is known.
    std::string awaited_reason() {
        const double start = seconds_now();
        while (true) {
            if (const std::string text = reason(); !text.empty() || seconds_now() - start > kWaitForReason) return text;
            std::this_thread::sleep_for(milliseconds(20));
        }
    }

    void set(const std::string& key, const std::vector<char>& value) {
        roster ? roster->set(key, value) : client->set(key, value);
    }
    std::vector<char> get(const std::string& key) {
        if (client) return client->get(key);
        while (true) {
            if (auto value = roster->get(key, 1)) return *value;
            check_whether_to_wait();
        }
    }
    void check_whether_to_wait() {
        if (const std::string text = reason(); !text.empty()) throw DeviceError(text);
        if (interrupted()) throw Interrupted("interrupted before all ranks had come");
    }

    /// Returns the address of this rank (not rank 0) for the other ranks; an empty text if it is the address by which
    /// they reach rank 0.
    std::string own_address() const {
        if (place.local_size == place.size) return "127.0.0.1";
        const Route route = route_to(place.master, place.port);
        return route.is_local() ? "" : route.own;
    }

    /// Returns a connection to each other rank. Each rank accepts connections from the ranks after it: rank 0 at the
    /// common port, the others at a port of their own.
    std::vector<Descriptor> connect_all() {
        const auto key = [](int r) { return "gsapp/address of rank " + std::to_string(r); };
        std::vector<Descriptor> to_rank(std::size_t(place.size));
        if (place.rank > 0 && place.rank + 1 < place.size) {
            const std::string host = own_address();
            port.emplace(host.empty() ? "0.0.0.0" : host, 0, place.rank, place.size, credentials);
            const std::string address = fmt::format("{} {}", port->port(), host);
            set(key(place.rank), {address.begin(), address.end()});
        }
        for (int r = 0; r < place.rank; ++r) {
            RankAddress address{r, place.master, place.port};
            if (r > 0) {
                const std::vector<char> text = get(key(r));
                std::istringstream words(std::string(text.begin(), text.end()));
                words >> address.port >> address.host;  // the host stays that of rank 0 if the text names none
            }
            ask(address, {RankRequest::Call::kConnect, place.rank, "", ""}, credentials, kLongestSilence,
                &to_rank[std::size_t(r)]);
        }
        for (int r = place.rank + 1; r < place.size; ++r) {
            std::optional<Descriptor> connection;
            while (!(connection = port->take(r, kLookForRank))) check_whether_to_wait();
            to_rank[std::size_t(r)] = std::move(*connection);
        }
        if (place.rank > 0) port.reset();
        return to_rank;
    }

    /// Waits for `time` and returns false, or returns true as soon as the group ends.
    bool ends_within(milliseconds time) {
        std::unique_lock lock(mutex);
        return ending_changed.wait_for(lock, time, [&] { return ending; });
    }

    void watch_on_rank_0() {
        while (!ends_within(kLook)) {
            if (processes)
                if (const auto lost = processes->first_lost()) {
                    // A rank reports its error before it ends, and only the first recorded failure is kept.
                    roster->fail(*lost);
                }
            roster->look_for_lost_ranks();
            if (!roster->failure().empty()) return break_off();
        }
    }

    void report_to_rank_0() {
        const std::string host = host_name();
        while (!ends_within(kReport)) {
            std::string text;
            try {
                text = client->report(host, kLongestSilence);
            } catch (const DeviceError& e) {
                text = e.what();
            }
            if (text.empty()) continue;
            {
                const std::lock_guard lock(mutex);
                failure = text;
            }
            break_off();
            // This rank may be in a long computation, whose result is no longer needed.
            if (!ends_within(kMostDelay)) ::_exit(int(ExitCode::kDevice));
            return;
        }
    }

    void break_off() {
        const std::lock_guard lock(mutex);
        if (communicator) communicator->abort();
    }

    void end() {
        {
            const std::lock_guard lock(mutex);
            ending = true;
        }
        ending_changed.notify_all();
        if (watch.joinable()) watch.join();
    }
};

std::unique_ptr<RankGroup> RankGroup::join(int local_ranks, const std::string& work) {
    const auto place = rank_place(environment);
    if (place && local_ranks > 1 && local_ranks != place->size)
        throw UsageError(fmt::format("option ranks: {} is not the number of processes that were started, which is {}",
                                     local_ranks, place->size));
    if (!place && local_ranks <= 1) return nullptr;
    auto group = std::make_unique<Implementation>();
    const Credentials& credentials = group->credentials = {place ? shared_secret(environment) : random_secret(),
                                                           job_of(work, place ? place->size : local_ranks)};
    if (!place) {
        group->place = {0, local_ranks, 0, local_ranks, "127.0.0.1", 0};
        group->roster.emplace(local_ranks);
        group->port.emplace("127.0.0.1", 0, 0, local_ranks, credentials, answers_of(*group->roster));
        group->processes.emplace(local_ranks, group->port->port(), credentials.secret);
    } else {
        group->place = *place;
        if (place->rank == 0) {
            group->roster.emplace(place->size);
            group->port.emplace("0.0.0.0", place->port, 0, place->size, credentials, answers_of(*group->roster));
        } else {
            end_with_rank_0();
            // Signals to all processes of a job are handled by rank 0, which ends the others after saving the model.
            for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, SIG_IGN);
            group->client.emplace(place->rank, place->master, place->port, credentials);
            const std::string failure = group->client->report(host_name(), kLongestWait);
            if (!failure.empty()) throw DeviceError(failure);
        }
    }
    Implementation* const watched = group.get();
    group->watch =
        std::thread([watched] { watched->roster ? watched->watch_on_rank_0() : watched->report_to_rank_0(); });
    return std::unique_ptr<RankGroup>(new RankGroup(std::move(group)));
}

RankGroup::RankGroup(std::unique_ptr<Implementation> implementation) : implementation_(std::move(implementation)) {}

RankGroup::~RankGroup() {
    Implementation& group = *implementation_;
    const bool whole = group.reason().empty();
    group.end();
    if (!group.roster) return;
    bool left = false;
    try {
        if (whole && group.communicator) {
            send_to_others(*group.communicator, MessageWriter().put(GroupCall::kLeave));
            left = true;
        }
    } catch (const Error&) {  // the connection was aborted during an exchange
    }
    if (!left) {
        group.roster->fail("rank 0 has ended");
        if (group.communicator) group.communicator->abort();  // no other rank takes part in an orderly end
        if (group.processes)
            group.processes->kill();
        else
            std::this_thread::sleep_for(2 * kReport);  // so that ranks on other machines receive the failure
    }
    group.communicator.reset();  // the devices disconnect from each other
    group.processes.reset();     // waits for the processes
}

int RankGroup::rank() const { return implementation_->place.rank; }
int RankGroup::size() const { return implementation_->place.size; }
int RankGroup::local_size() const { return implementation_->place.local_size; }
int RankGroup::local_rank() const { return implementation_->place.local_rank; }

void RankGroup::set(const std::string& key, const std::string& value) {
    implementation_->set("gsapp/" + key, {value.begin(), value.end()});
}
std::string RankGroup::get(const std::string& key) {
    const auto value = implementation_->get("gsapp/" + key);
    return {value.begin(), value.end()};
}

Communicator& RankGroup::communicator() {
    Implementation& group = *implementation_;
    if (group.communicator) return *group.communicator;
    std::unique_ptr<Communicator> connection;
    try {
        connection = connect_by_sockets(rank(), group.connect_all());
    } catch (const DeviceError& e) {
        const std::string reason = group.awaited_reason();
        throw DeviceError(reason.empty() ? e.what() : reason);
    }
    auto explaining =
        std::make_unique<ExplainingCommunicator>(std::move(connection), [&group] { return group.awaited_reason(); });
    const std::lock_guard lock(group.mutex);
    group.communicator = std::move(explaining);
    // An earlier failure could not abort the communicator, which did not exist yet.
    if (!group.failure.empty() || (group.roster && !group.roster->failure().empty())) group.communicator->abort();
    return *group.communicator;
}

std::string RankGroup::connect_devices(const std::string& device) {
    if (std::exchange(implementation_->asked_devices, true)) return "";
    try {
        return gs::connect_devices(communicator(), device);
    } catch (const DeviceError& e) {
        const std::string reason = implementation_->awaited_reason();
        throw DeviceError(reason.empty() ? e.what() : reason);
    }
}

void RankGroup::agree(const std::string& text) {
    constexpr const char* kStarted = "options";
    if (rank() == 0) return set(kStarted, text);
    const std::string first = get(kStarted);
    std::istringstream a(first), b(text);
    for (std::string line_a, line_b; std::getline(a, line_a) && std::getline(b, line_b);)
        if (line_a != line_b)
            throw UsageError(fmt::format("it was started with '{}', rank 0 with '{}'", line_b, line_a));
    if (first != text) throw UsageError("its options are not those of rank 0");
}

void RankGroup::follow(const std::function<void()>& part) {
    try {
        part();
    } catch (const std::bad_alloc&) {
        if (!fail("out of memory")) throw;
        throw DeviceError("");
    } catch (const std::exception& e) {
        if (!fail(e.what())) throw;
        throw DeviceError("");  // rank 0 prints the message
    }
}

/// Sends the reason for this rank's end to rank 0. Returns false if rank 0 cannot be reached.
bool RankGroup::fail(const std::string& message) {
    try {
        implementation_->client->fail(fmt::format("rank {} on {}: {}", rank(), host_name(), message));
        return true;
    } catch (const DeviceError&) {
        return false;
    }
}

}  // namespace gs
