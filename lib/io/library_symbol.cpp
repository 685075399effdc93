// SPDX-License-Identifier: Apache-2.0
// Compiled without unwind tables, so that an exception in a library's initialisation finds no handler above it. Some
// libraries start threads there and would wait forever during unwinding, and dlopen would not release its locks.
#include "lib/io/library_symbol.h"

#include <dlfcn.h>

namespace gs {

const void* library_symbol(const char* file, const char* name) noexcept {
    void* const library = ::dlopen(file, RTLD_LAZY | RTLD_LOCAL);
    return library ? ::dlsym(library, name) : nullptr;
}

}  // namespace gs
