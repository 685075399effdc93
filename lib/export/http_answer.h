// SPDX-License-Identifier: Apache-2.0
// The answer to an HTTP request for a file of one folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "lib/export/file_descriptor.h"
#include "lib/export/http_request.h"

namespace gs {

/// First `head` is sent, which holds the body of short answers, then `length` bytes of `file` from `first` on.
struct HttpAnswer {
    std::string head;
    FileDescriptor file;
    std::uint64_t first = 0, length = 0;
    bool keep_alive = false;  ///< whether the connection may carry another request afterwards
};

/// Answers a request for a file in `root`, which must be canonical; "/" is index.html. 404 for a path that leads out of
/// it, 405 for methods that do not read, 416 for a range beyond the file, 421 for a host that is not this machine.
HttpAnswer answer_request(const std::filesystem::path& root, const HttpRequest& request);

/// Answers what could not be read as a request; the connection ends.
HttpAnswer answer_refusal(const HttpRefusal& refusal);

}  // namespace gs
