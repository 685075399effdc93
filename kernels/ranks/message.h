// SPDX-License-Identifier: Apache-2.0
// Serialized values, as one rank sends them to another of the same build, and the serialization of the structures of
// the Backend interface.
#pragma once

#include <string>

#include "kernels/base/error.h"
#include "kernels/ranks/communicator.h"
#include "kernels/requests.h"

namespace gs {

class MessageWriter {
  public:
    /// Reserves memory for that many more bytes.
    void reserve(std::size_t bytes) { bytes_.reserve(bytes_.size() + bytes); }
    template <class T> MessageWriter& put(const T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        return append(&value, sizeof value);
    }
    template <class T> MessageWriter& put(const std::vector<T>& values) {
        static_assert(std::is_trivially_copyable_v<T>);
        put(std::uint64_t(values.size()));
        return append(values.data(), values.size() * sizeof(T));
    }
    /// Writes a string.
    MessageWriter& put(const std::string& text) { return put(std::vector<char>(text.begin(), text.end())); }
    const std::vector<std::byte>& bytes() const { return bytes_; }

  private:
    MessageWriter& append(const void* data, std::size_t size) {
        const std::size_t at = bytes_.size();
        bytes_.resize(at + size);
        if (size > 0) std::memcpy(bytes_.data() + at, data, size);
        return *this;
    }
    std::vector<std::byte> bytes_;
};

/// Reads the values that a MessageWriter wrote, in the same order. Throws DataError if a message is too short.
class MessageReader {
  public:
    explicit MessageReader(std::vector<std::byte> bytes) : bytes_(std::move(bytes)) {}

    template <class T> T get() {
        T value;
        take(&value, sizeof value);
        return value;
    }
    template <class T> void get(T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        take(&value, sizeof value);
    }
    template <class T> void get(std::vector<T>& values) {
        static_assert(std::is_trivially_copyable_v<T>);
        const auto size = get<std::uint64_t>();
        if (size > (bytes_.size() - at_) / sizeof(T)) throw DataError("a message between ranks is too short");
        values.resize(size);
        take(values.data(), size * sizeof(T));
    }
    void get(std::string& text) {
        std::vector<char> characters;
        get(characters);
        text.assign(characters.begin(), characters.end());
    }

    /// Returns whether everything was read.
    bool at_end() const { return at_ == bytes_.size(); }

  private:
    void take(void* to, std::size_t size) {
        if (size > bytes_.size() - at_) throw DataError("a message between ranks is too short");
        if (size > 0) std::memcpy(to, bytes_.data() + at_, size);
        at_ += size;
    }
    std::vector<std::byte> bytes_;
    std::size_t at_ = 0;
};

/// Bytes sent first for every message, 8 of which hold its length; the rest of a longer message follows.
inline constexpr std::size_t kFirstPacketBytes = 2048;

/// Sends a message from rank 0 to all other ranks, and receives it there.
void send_to_others(Communicator& ranks, const MessageWriter& message);
MessageReader receive_from_rank_0(Communicator& ranks);
/// Sends a message to one other rank.
void send_to(Communicator& ranks, int rank, const MessageWriter& message);

/// A serialized step lacks the pixels of its target: the rank that renders the view reads them by the target's id.
void put(MessageWriter& to, const StepRequest& request);
void get(MessageReader& from, StepRequest& request);
void put(MessageWriter& to, const std::vector<StepRequest>& requests);
void get(MessageReader& from, std::vector<StepRequest>& requests);

void put(MessageWriter& to, const Gaussians& model);
void get(MessageReader& from, Gaussians& model);
void put(MessageWriter& to, const PpispState& state);
void get(MessageReader& from, PpispState& state);

}  // namespace gs
