// SPDX-License-Identifier: Apache-2.0
// Mutated request heads: each is read or refused, and no range leaves the file.
#include "lib/export/http_request.h"

#include <gtest/gtest.h>

#include <random>

namespace gs::test {
namespace {

/// Returns the status of the refusal, 200 for a head that is read, and 0 for one that is not complete.
int read_status(const std::string& bytes) {
    try {
        const std::size_t length = http_head_length(bytes);
        if (length == 0) return 0;
        EXPECT_LE(length, std::min(bytes.size(), kMaxRequestHead));
        const HttpRequest request = parse_http_request(std::string_view(bytes).substr(0, length));
        EXPECT_FALSE(request.method.empty());
        EXPECT_LE(request.path.size(), kMaxRequestLine);
        ByteRange range;
        const auto value = request.fields.find("range");
        if (value != request.fields.end() && parse_byte_range(value->second, 1000, range) == RangeKind::kPart) {
            EXPECT_GT(range.length, 0u) << value->second;
            EXPECT_LE(range.first + range.length, 1000u) << value->second;
        }
        return 200;
    } catch (const HttpRefusal& refusal) {
        EXPECT_FALSE(refusal.sentence.empty());
        return refusal.status;
    }
}

TEST(HttpRequest, MutatedHeadsAreReadOrRefused) {
    const std::string seeds[] = {
        "GET / HTTP/1.1\r\nHost: localhost:8000\r\nConnection: keep-alive, Close\r\n\r\n",
        "GET /a%20b/c?x=%zz HTTP/1.1\r\nHost: 127.0.0.1\r\nRange: bytes=10-20\r\n\r\n",
        "HEAD http://[::1]:80/x HTTP/1.0\r\nHost: [::1]:80\r\nRange: bytes=-5\r\nContent-Length: 0\r\n\r\n",
    };
    const std::string hostile[] = {"\r\n",
                                   "\r",
                                   "\n",
                                   ":",
                                   " ",
                                   "%",
                                   "%00",
                                   std::string(1, '\0'),
                                   "\xff",
                                   "[",
                                   "]",
                                   "-",
                                   "99999999999999999999",
                                   "bytes=",
                                   ",",
                                   "Host: x\r\n",
                                   std::string(9000, 'a')};
    std::mt19937 random(16);
    int read = 0, refused = 0;
    for (int i = 0; i < 20000; ++i) {
        std::string bytes = seeds[random() % std::size(seeds)];
        for (unsigned changes = 1 + random() % 3; changes > 0; --changes) {
            const std::size_t at = random() % (bytes.size() + 1);
            switch (random() % 4) {
                case 0:
                    bytes.insert(at, hostile[random() % std::size(hostile)]);
                    break;
                case 1:
                    bytes.erase(at, 1 + random() % 4);
                    break;
                case 2:
                    if (at < bytes.size()) bytes[at] = char(random() % 256);
                    break;
                case 3:
                    bytes.resize(at);
                    break;
            }
        }
        const int status = read_status(bytes);
        read += status == 200;
        refused += status >= 400;
    }
    EXPECT_GT(read, 1000);
    EXPECT_GT(refused, 1000);
}

}  // namespace
}  // namespace gs::test
