// SPDX-License-Identifier: Apache-2.0
// Connects ranks through Gloo over TCP.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "kernels/ranks/communicator.h"

namespace gs {

/// A place where ranks find each other: values by key, which all see.
class MeetingPlace {
  public:
    virtual ~MeetingPlace() = default;
    virtual void set(const std::string& key, const std::vector<char>& value) = 0;
    /// Waits for the value. Throws DeviceError when it does not come in time.
    virtual std::vector<char> get(const std::string& key) = 0;
};

/// Connects this rank with all others. `host` is the name or address of this machine by which the others reach it.
/// Throws DeviceError when one of them cannot be reached.
std::unique_ptr<Communicator> connect_with_gloo(MeetingPlace& place, int rank, int size, const std::string& host);

}  // namespace gs
