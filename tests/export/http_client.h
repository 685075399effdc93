// SPDX-License-Identifier: Apache-2.0
// An HTTP client that sends exactly the bytes it is given.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <map>
#include <string>

namespace gs::test {

struct HttpResult {
    int status = -1;                            ///< -1: no answer
    std::map<std::string, std::string> fields;  ///< names as sent
    std::string body;
};

/// One connection to 127.0.0.1. Nothing waits longer than ten seconds.
class HttpClient {
  public:
    explicit HttpClient(int port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
        const timeval patience = {10, 0};
        ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
        sockaddr_in address = {};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        address.sin_port = htons(static_cast<std::uint16_t>(port));
        EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    }
    HttpClient(const HttpClient&) = delete;
    HttpClient& operator=(const HttpClient&) = delete;
    ~HttpClient() { ::close(socket_); }

    /// Returns false when the server has closed the connection.
    bool send(const std::string& bytes) const {
        return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == ssize_t(bytes.size());
    }

    /// Reads one answer; `with_body` is false for that to HEAD.
    HttpResult receive(bool with_body = true) {
        HttpResult result;
        std::size_t end;
        while ((end = input_.find("\r\n\r\n")) == std::string::npos)
            if (!more()) return result;
        const std::string head = input_.substr(0, end + 2);
        input_.erase(0, end + 4);
        result.status = std::atoi(head.c_str() + head.find(' '));
        for (std::size_t at = head.find("\r\n") + 2; at < head.size(); at = head.find("\r\n", at) + 2) {
            const std::size_t colon = head.find(": ", at);
            result.fields[head.substr(at, colon - at)] = head.substr(colon + 2, head.find("\r\n", at) - colon - 2);
        }
        const std::size_t length = with_body ? std::size_t(std::atoll(result.fields["Content-Length"].c_str())) : 0;
        while (input_.size() < length)
            if (!more()) return {};
        result.body = input_.substr(0, length);
        input_.erase(0, length);
        return result;
    }
    /// Waits for the end of the connection; false when something else comes, or nothing for `seconds`.
    bool is_ended(int seconds = 10) {
        pollfd ready = {socket_, POLLIN, 0};
        return input_.empty() && ::poll(&ready, 1, 1000 * seconds) == 1 && !more();
    }

  private:
    bool more() {
        char bytes[65536];
        const ssize_t n = ::recv(socket_, bytes, sizeof bytes, 0);
        if (n > 0) input_.append(bytes, std::size_t(n));
        return n > 0;
    }

    int socket_;
    std::string input_;
};

/// A request with the fields that each must have, as text; `fields` are whole lines.
inline std::string http_request(const std::string& path, const std::string& fields = "",
                                const std::string& method = "GET") {
    return method + " " + path + " HTTP/1.1\r\nHost: 127.0.0.1:8000\r\n" + fields + "\r\n";
}

/// Fetches one file over a connection of its own.
inline HttpResult http_get(int port, const std::string& path, const std::string& fields = "",
                           const std::string& method = "GET") {
    HttpClient client(port);
    client.send(http_request(path, fields, method));
    return client.receive(method != "HEAD");
}

}  // namespace gs::test
