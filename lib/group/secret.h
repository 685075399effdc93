// SPDX-License-Identifier: Apache-2.0
// The secret with which the ranks of a job authenticate each other.
#pragma once

#include <string>

#include "lib/group/rank_place.h"

namespace gs {

/// The environment variable that holds the secret. Other users cannot read it, unlike a command line.
inline constexpr const char* kSecretVariable = "GSAPP_RANK_SECRET";

/// Returns a new secret: 256 bits in hexadecimal digits.
std::string random_secret();

/// Returns the secret of ranks that another program started: the value of kSecretVariable, or else the content of
/// gsapp/rank_secret in XDG_CONFIG_HOME (~/.config). The first rank that needs the file creates it, with mode 600.
/// Throws UsageError for a secret of less than 16 characters, for a file that other users may read or write or that
/// belongs to another user, and if there is no file and none can be created.
std::string shared_secret(const Environment& variable);

}  // namespace gs
