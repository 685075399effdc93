// SPDX-License-Identifier: Apache-2.0
// Compiled without tables for unwinding, so that no exception of a library's initialisation finds a handler above it.
// Some libraries start threads there and wait for ever when they are unwound; and dlopen would not give back its locks.
#include "lib/io/library_symbol.h"

#include <dlfcn.h>

namespace gs {

const void* library_symbol(const char* file, const char* name) noexcept {
    void* const library = ::dlopen(file, RTLD_LAZY | RTLD_LOCAL);
    return library ? ::dlsym(library, name) : nullptr;
}

}  // namespace gs
