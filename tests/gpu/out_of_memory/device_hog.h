// SPDX-License-Identifier: Apache-2.0
// Takes device memory away from the code under test.
#pragma once

#include <cstddef>
#include <vector>

namespace gs::test {

/// Holds all device memory but about `left` bytes of it until released.
class DeviceHog {
  public:
    explicit DeviceHog(std::size_t left);
    DeviceHog(const DeviceHog&) = delete;
    DeviceHog& operator=(const DeviceHog&) = delete;
    ~DeviceHog() { release(); }
    void release();
    static std::size_t free_bytes();

  private:
    std::vector<void*> pieces_;
};

}  // namespace gs::test
