// SPDX-License-Identifier: Apache-2.0
// Loads a shared library while the program runs.
#pragma once

namespace gs {

/// Loads the library with all that it needs, whose functions are looked up when they are called first, and returns the
/// address of its symbol `name`, or nullptr, in which case dlerror() says why. An exception in the initialisation of a
/// library, which has no handler, goes to std::terminate at once as it does in that of a program: nothing is unwound.
const void* library_symbol(const char* file, const char* name) noexcept;

}  // namespace gs
