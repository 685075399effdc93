// SPDX-License-Identifier: Apache-2.0
// Functions that rank 0 calls together with the other ranks. Whoever adds one writes the function and adds it to the
// table of kernels/ranks/backend.cpp; its arguments are sent as their types say.
#pragma once

#include <tuple>
#include <type_traits>

#include "kernels/base/error.h"
#include "kernels/ranks/messages.h"

namespace gs {

/// Writes one argument. A pointer is to what rank 0 alone has: it is not sent, and null on the other ranks.
template <class T> void put_argument(MessageWriter& to, const T& value) {
    if constexpr (std::is_pointer_v<T>)
        return;
    else if constexpr (requires { put(to, value); })
        put(to, value);
    else
        to.put(value);
}

template <class T> T get_argument(MessageReader& from) {
    T value{};
    if constexpr (std::is_pointer_v<T>)
        return value;
    else if constexpr (requires { get(from, value); })
        get(from, value);
    else
        from.get(value);
    return value;
}

/// Member functions of `Object`, numbered in their order.
template <class Object, auto... kFunctions> class CallTable {
  public:
    template <auto kFunction> static constexpr std::uint32_t number() {
        std::uint32_t k = 0;
        const bool found = ((std::is_same_v<Tag<kFunctions>, Tag<kFunction>> || (++k, false)) || ...);
        return found ? k : throw "the function is not in the table";  // which a constant cannot do
    }
    /// Reads the arguments of the function with that number, and calls it.
    static void call(std::uint32_t number, Object& object, MessageReader& message) {
        constexpr void (*kCalls[])(Object&, MessageReader&) = {&read_and_call<kFunctions>...};
        if (number >= sizeof...(kFunctions)) throw DataError("a message between ranks asks for an unknown function");
        kCalls[number](object, message);
    }

  private:
    template <auto kFunction> struct Tag {};

    template <auto kFunction> static void read_and_call(Object& object, MessageReader& message) {
        call_with(kFunction, object, message);
    }
    template <class Result, class... Arguments>
    static void call_with(Result (Object::*function)(Arguments...), Object& object, MessageReader& message) {
        // Braces let the arguments be read in their order.
        std::tuple<std::decay_t<Arguments>...> arguments{get_argument<std::decay_t<Arguments>>(message)...};
        std::apply([&](auto&... values) { (object.*function)(values...); }, arguments);
    }
};

}  // namespace gs
