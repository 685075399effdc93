// SPDX-License-Identifier: Apache-2.0
// Finds or creates the secret of a job.
#include "lib/group/secret.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/rand.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "kernels/base/descriptor.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// The minimum length of a secret; shorter secrets can be guessed by brute force.
constexpr std::size_t kLeastCharacters = 16;
constexpr std::size_t kMostCharacters = 4096;

std::string trimmed(const std::string& text) {
    constexpr const char* kSpace = " \t\r\n";
    const std::size_t first = text.find_first_not_of(kSpace);
    return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(kSpace) + 1 - first);
}

std::string checked(const std::string& text, const std::string& where) {
    const std::string secret = trimmed(text);
    if (secret.size() < kLeastCharacters)
        throw UsageError(
            fmt::format("{}: a secret of {} characters can be guessed; 'openssl rand -hex 32' prints one that cannot",
                        where, secret.size()));
    return secret;
}

/// Returns the secret in the file, or an empty text if there is no such file.
std::string read_secret(const fs::path& path) {
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (!file.is_open() && (errno == ENOENT || errno == ENOTDIR)) return "";
    struct stat status {};
    if (!file.is_open() || ::fstat(file.fd(), &status) != 0)
        throw UsageError(fmt::format("{}: cannot be read: {}", path.string(), std::strerror(errno)));
    if (!S_ISREG(status.st_mode)) throw UsageError(fmt::format("{}: it is no regular file", path.string()));
    if (status.st_uid != ::geteuid())
        throw UsageError(fmt::format("{}: it belongs to another user, who knows the secret then", path.string()));
    if (status.st_mode & 077)
        throw UsageError(
            fmt::format("{}: other users may read or write it (mode {:o}), so it holds no secret; delete "
                        "it, and gsapp makes another",
                        path.string(), status.st_mode & 0777));
    std::string text(kMostCharacters, '\0');
    const ssize_t size = ::read(file.fd(), text.data(), text.size());
    if (size < 0) throw UsageError(fmt::format("{}: cannot be read: {}", path.string(), std::strerror(errno)));
    text.resize(std::size_t(size));
    return checked(text, path.string());
}

/// Creates the file with a new secret atomically. Keeps a file that another rank created meanwhile. Throws
/// std::system_error.
void make_secret(const fs::path& path) {
    fs::create_directories(path.parent_path());
    const std::string text = random_secret() + "\n", temporary = path.string() + "." + random_secret().substr(0, 16);
    const auto require = [](bool done) {
        if (!done) throw std::system_error(errno, std::generic_category());
    };
    {
        const Descriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
        require(file.is_open());
        require(::write(file.fd(), text.data(), text.size()) == ssize_t(text.size()) && ::fsync(file.fd()) == 0);
    }
    const bool linked = ::link(temporary.c_str(), path.c_str()) == 0 || errno == EEXIST;
    const int error = errno;
    ::unlink(temporary.c_str());
    errno = error;
    require(linked);
}

}  // namespace

std::string random_secret() {
    std::array<unsigned char, 32> bytes;
    if (::RAND_bytes(bytes.data(), int(bytes.size())) != 1)
        throw Error(ExitCode::kUnexpected, "the system gives no random numbers for the secret of the ranks");
    std::string text;
    for (const unsigned char byte : bytes) text += fmt::format("{:02x}", byte);
    return text;
}

std::string shared_secret(const Environment& variable) {
    if (const char* value = variable(kSecretVariable))
        return checked(value, fmt::format("environment variable {}", kSecretVariable));
    const char *config = variable("XDG_CONFIG_HOME"), *home = variable("HOME");
    const std::string advice =
        fmt::format("set {} to the same secret for all ranks ('openssl rand -hex 32' prints one)", kSecretVariable);
    if (!(config && *config) && !(home && *home))
        throw UsageError(fmt::format("the ranks have no secret, and there is no HOME to keep one in: {}", advice));
    const fs::path path = (config && *config ? fs::path(config) : fs::path(home) / ".config") / "gsapp" / "rank_secret";
    if (const std::string secret = read_secret(path); !secret.empty()) return secret;
    try {
        make_secret(path);
    } catch (const std::system_error& e) {
        throw UsageError(fmt::format("the ranks have no secret, and {} cannot be made ({}): {}", path.string(),
                                     e.code().message(), advice));
    }
    return read_secret(path);
}

}  // namespace gs
