// SPDX-License-Identifier: Apache-2.0
// Creates, renews, checks and takes over claim files.
#include "eval/experiments/job_claim.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>

#include "kernels/base/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// Time after which a process that replaced a file checks whether another process did so at the same moment.
constexpr std::chrono::milliseconds kSettle{500};

/// Returns a name for the scope of process numbers: machines may share a host name, and containers a machine.
const std::string& machine() {
    static const std::string name = [] {
        char host[HOST_NAME_MAX + 1] = {}, space[64] = {};
        ::gethostname(host, HOST_NAME_MAX);
        const ssize_t size = ::readlink("/proc/self/ns/pid", space, sizeof space - 1);
        std::string boot;
        std::ifstream("/proc/sys/kernel/random/boot_id") >> boot;
        return fmt::format("{}/{}/{}", host, boot, std::string_view(space, size > 0 ? std::size_t(size) : 0));
    }();
    return name;
}

/// Returns the owner text of a file that this process creates: machine, process, and a unique number.
std::string new_owner() {
    static std::atomic<int> count{0};
    return fmt::format("{} {} {}.{}\n", machine(), ::getpid(), Clock::now().time_since_epoch().count(), ++count);
}

/// Returns the content of a file, empty if there is none; nothing if it cannot be read at the moment.
std::optional<std::string> content(const fs::path& file) {
    const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return errno == ENOENT ? std::optional(std::string()) : std::nullopt;
    std::string text;
    char part[512];
    ssize_t size;
    while ((size = ::read(fd, part, sizeof part)) > 0) text.append(part, std::size_t(size));
    ::close(fd);
    return size < 0 ? std::nullopt : std::optional(text);
}

/// Splits the content of a file into its first line, which names the owner, and the note below.
std::pair<std::string, std::string> owner_and_note(const std::string& text) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    return {text.substr(0, end), text.substr(std::min(end + 1, text.size()))};
}

/// Machine name in files whose owner has released its claim and left the file.
constexpr std::string_view kNobody = "nobody";

/// Writes a file that appears under its name only with its full content. It need not survive a crash of the machine.
void replace_file(const fs::path& file, const std::string& text) {
    static std::atomic<int> count{0};
    const fs::path temporary = fmt::format("{}.{}.{}", file.string(), ::getpid(), ++count);
    std::error_code error, ignored;
    if (std::ofstream out(temporary); !(out << text).flush())
        error = std::make_error_code(std::errc::io_error);
    else
        fs::rename(temporary, file, error);
    if (!error) return;
    fs::remove(temporary, ignored);
    throw DataError(fmt::format("cannot replace '{}': {}", file.string(), error.message()));
}

/// Returns whether the owner is nobody, or a process of this machine that has ended.
bool has_ended(const std::string& owner) {
    std::istringstream words(owner);
    std::string where;
    long pid = 0;
    if (!(words >> where >> pid)) return false;
    return where == kNobody || (where == machine() && pid > 0 && ::kill(pid_t(pid), 0) != 0 && errno == ESRCH);
}

}  // namespace

JobNote read_note(const fs::path& file) {
    std::error_code error;
    const fs::file_time_type time = fs::last_write_time(file, error);
    const std::optional<std::string> text = error ? std::nullopt : content(file);
    if (!text || text->empty()) return {};
    auto [owner, note] = owner_and_note(*text);
    return {std::move(owner), std::move(note), time};
}

JobClaim::JobClaim(fs::path file, std::string owner, std::chrono::milliseconds renew_every, bool leave)
    : file_(std::move(file)), owner_(std::move(owner)), renew_every_(renew_every), leave_(leave), renewer_([this] {
          renew();
      }) {}

JobClaim::~JobClaim() {
    {
        const std::lock_guard lock(mutex_);
        ends_ = true;
    }
    wake_.notify_all();
    renewer_.join();
    std::error_code ignored;
    if (content(file_) != owner_) return;
    if (!leave_) {
        fs::remove(file_, ignored);
        return;
    }
    try {
        replace_file(file_, fmt::format("{} 0\n{}", kNobody, owner_and_note(owner_).second));
    } catch (const DataError&) {  // others will see that it is no longer renewed
    }
}

bool JobClaim::lost() const {
    const std::lock_guard lock(mutex_);
    return lost_;
}

void JobClaim::renew() {
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, renew_every_, [this] { return ends_; })) {
        const std::optional<std::string> owner = content(file_);
        lost_ = owner && *owner != owner_;
        if (lost_) return;
        ::utimensat(AT_FDCWD, file_.c_str(), nullptr, 0);
    }
}

bool JobClaims::held(const fs::path& file) {
    std::error_code error;
    const fs::file_time_type time = fs::last_write_time(file, error);
    if (error) {
        seen_.erase(file);
        return false;
    }
    const std::optional<std::string> owner = content(file);
    if (!owner) return true;  // checked again later
    const auto now = Clock::now();
    const auto [at, is_new] = seen_.try_emplace(file, Seen{*owner, time, now});
    Seen& seen = at->second;
    if (!is_new && (seen.owner != *owner || seen.time != time)) seen = {*owner, time, now};
    return !has_ended(*owner) && now - seen.since < stale_after_;
}

std::unique_ptr<JobClaim> JobClaims::take(const fs::path& file) {
    if (held(file)) return nullptr;
    const std::string owner = new_owner();
    std::error_code error;
    fs::create_directories(file.parent_path(), error);  // if this failed, creating the file reports why
    const int fd = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd >= 0) {
        const bool written = ::write(fd, owner.data(), owner.size()) == ssize_t(owner.size());
        const int reason = errno;
        if (::close(fd) != 0 || !written) {
            fs::remove(file, error);
            throw DataError(fmt::format("cannot write '{}': {}", file.string(), std::strerror(reason)));
        }
    } else if (errno != EEXIST) {
        throw DataError(fmt::format("cannot create '{}': {}", file.string(), std::strerror(errno)));
    } else {
        // Created by another process a moment ago, or released, in which case the next attempt finds no file.
        if (held(file) || !fs::exists(file, error)) return nullptr;
        // If several processes replace the file at the same moment, the last one holds the claim.
        replace_file(file, owner);
        std::this_thread::sleep_for(kSettle);
        if (content(file) != owner) return nullptr;
    }
    seen_.erase(file);
    return std::make_unique<JobClaim>(file, owner, stale_after_ / 6);
}

std::unique_ptr<JobClaim> JobClaims::tell(const fs::path& file, const std::string& note) {
    const std::string text = new_owner() + note;
    replace_file(file, text);
    return std::make_unique<JobClaim>(file, text, stale_after_ / 6, true);
}

}  // namespace gs
