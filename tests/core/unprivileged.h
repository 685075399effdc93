// SPDX-License-Identifier: Apache-2.0
// Lets a test meet permissions although it runs as root, whom they do not bind.
#pragma once

#include <unistd.h>

namespace gs::test {

/// While it lives the process acts as the user "nobody" if it was root, and as before otherwise.
class Unprivileged {
  public:
    Unprivileged() : was_root_(::geteuid() == 0) {
        if (was_root_ && ::seteuid(kNobody) != 0) was_root_ = false;
    }
    Unprivileged(const Unprivileged&) = delete;
    Unprivileged& operator=(const Unprivileged&) = delete;
    ~Unprivileged() {
        if (was_root_ && ::seteuid(0) != 0) _exit(1);
    }
    /// False where root could not become another user: permissions cannot be tested then.
    bool bound() const { return ::geteuid() != 0; }

  private:
    static constexpr uid_t kNobody = 65534;
    bool was_root_;
};

}  // namespace gs::test
