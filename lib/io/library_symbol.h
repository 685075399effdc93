// SPDX-License-Identifier: Apache-2.0
// Loads a shared library at run time.
#pragma once

namespace gs {

/// Loads the library and its dependencies, with lazy binding of their functions, and returns the address of its symbol
/// `name`. Returns nullptr on failure; dlerror() then gives the reason. An exception in a library's initialisation has
/// no handler and calls std::terminate at once, without unwinding, as during a program's start.
const void* library_symbol(const char* file, const char* name) noexcept;

}  // namespace gs
