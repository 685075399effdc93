// SPDX-License-Identifier: Apache-2.0
// The addresses by which two machines reach each other.
#pragma once

#include <string>

namespace gs {

/// The two ends of the way to another machine, as numbers: "10.0.0.7".
struct Route {
    std::string own, other;
    /// Returns whether the way does not leave this machine.
    bool is_local() const { return own == other || own.starts_with("127.") || own == "::1"; }
};

/// Returns the way by which packets to `host` would go; nothing is sent. (A machine's own name often leads to
/// 127.0.1.1, where no other machine finds it.) Throws DeviceError for a name that is not known, or cannot be reached.
Route route_to(const std::string& host, int port);

}  // namespace gs
