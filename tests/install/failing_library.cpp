// SPDX-License-Identifier: Apache-2.0
// A library that fails while it is loaded, as some do that get no threads, and must not be unwound then.
#include <cstdlib>
#include <new>

namespace {

struct Waiting {
    ~Waiting() { std::abort(); }  // instead of waiting for ever
};

[[gnu::constructor]] void fail() {
    const Waiting threads;
    throw std::bad_alloc();
}

}  // namespace
