// SPDX-License-Identifier: Apache-2.0
// Asks the system by connecting a socket for datagrams.
#include "lib/group/route.h"

#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>

#include "kernels/base/error.h"

namespace gs {
namespace {

std::string text_of(const sockaddr_storage& address, socklen_t size) {
    char text[NI_MAXHOST] = {};
    ::getnameinfo(reinterpret_cast<const sockaddr*>(&address), size, text, sizeof text, nullptr, 0, NI_NUMERICHOST);
    return text;
}

}  // namespace

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
