// SPDX-License-Identifier: Apache-2.0
// The server of `gsapp view`, which a client sends anything.
#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <stdexcept>
#include <thread>

#include "lib/export/file_server.h"
#include "tests/fuzz/target.h"

namespace gs::fuzz {
namespace {

/// A server that runs as long as the process.
int server_port() {
    static FileServer* const server = [] {
        put("site/index.html", "<p>page</p>");
        put("site/scene.ngsplat", std::string(5000, 's'));
        put("secret.txt", "the secret");
        auto* made = new FileServer(folder() / "site", 0);
        std::thread([made] { made->run(); }).detach();
        return made;
    }();
    return server->port();
}

/// Sends the bytes, closes the sending side and returns all that comes back within two seconds.
std::string answer_to(const std::string& bytes) {
    const int connection = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(std::uint16_t(server_port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const timeval patience{2, 0};
    ::setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    if (::connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
        ::close(connection);
        throw std::runtime_error("the server does not take connections any more");
    }
    if (::send(connection, bytes.data(), bytes.size(), MSG_NOSIGNAL) < 0) {
    }  // the server may have closed already, which is its right
    ::shutdown(connection, SHUT_WR);
    std::string answer;
    char buffer[4096];
    for (ssize_t n; (n = ::recv(connection, buffer, sizeof buffer, 0)) > 0;) answer.append(buffer, std::size_t(n));
    ::close(connection);
    return answer;
}

void request(const std::string& bytes) {
    if (answer_to(bytes).find("the secret") != std::string::npos)
        throw std::runtime_error("the server sent a file outside of its folder");
}

}  // namespace

std::vector<Target> server_targets() {
    return {
        {"request.http",
         [] {
             return std::vector<std::string>{
                 "GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
                 "GET /scene.ngsplat HTTP/1.1\r\nHost: 127.0.0.1\r\nRange: bytes=10-20\r\nConnection: close\r\n\r\n",
                 "HEAD /../secret.txt HTTP/1.0\r\n\r\n", "GET /%2e%2e/secret.txt HTTP/1.1\r\nHost: localhost\r\n\r\n"};
         },
         request}};
}

}  // namespace gs::fuzz
