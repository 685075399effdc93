// SPDX-License-Identifier: Apache-2.0
// Reads and writes the safetensors container: checks the header before any allocation and streams the data.
#include "lib/io/safetensors.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/utf8.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little, "safetensors data is little endian");

constexpr std::array<const char*, 4> kDtypeNames = {"F32", "F64", "I64", "U8"};
constexpr std::array<std::uint64_t, 4> kDtypeBytes = {4, 8, 8, 1};

/// The format's own limit. It also protects the JSON parser from absurd inputs.
constexpr std::uint64_t kMaxHeaderBytes = 100'000'000;

/// Computes the size of a tensor in bytes. Returns false if a dimension is negative or the product does not fit in 64
/// bits.
bool tensor_bytes(Dtype dtype, const std::vector<std::int64_t>& shape, std::uint64_t& bytes) {
    bytes = kDtypeBytes[std::size_t(dtype)];
    for (const std::int64_t n : shape) {
        if (n < 0 || __builtin_mul_overflow(bytes, std::uint64_t(n), &bytes)) return false;
    }
    return true;
}

}  // namespace

void write_safetensors(const std::filesystem::path& path, std::span<const TensorView> tensors,
                       const std::map<std::string, std::string>& metadata) {
    nlohmann::ordered_json header = nlohmann::ordered_json::object();
    // Option texts may hold any byte that a path can hold. Readers of other programs reject a header with escapes of
    // single bytes, so such bytes are replaced here.
    for (const auto& [key, value] : metadata) header["__metadata__"][key] = printable(value);
    std::uint64_t offset = 0;
    std::vector<std::uint64_t> sizes;
    for (const TensorView& t : tensors) {
        std::uint64_t bytes = 0;
        if (!tensor_bytes(t.dtype, t.shape, bytes))
            throw DataError(
                fmt::format("cannot write '{}': tensor '{}' has an impossible shape", path.string(), t.name));
        header[t.name] = {{"dtype", kDtypeNames[std::size_t(t.dtype)]},
                          {"shape", t.shape},
                          {"data_offsets", {offset, offset + bytes}}};
        offset += bytes;
        sizes.push_back(bytes);
    }
    std::string text = json_text(header);
    text.resize((text.size() + 7) / 8 * 8, ' ');  // aligned to 8 bytes, so that readers can map the file

    AtomicFile file(path);
    const std::uint64_t length = text.size();
    file.stream().write(reinterpret_cast<const char*>(&length), sizeof length);
    file.stream().write(text.data(), std::streamsize(text.size()));
    for (std::size_t i = 0; i < tensors.size(); ++i) {
        if (sizes[i] > 0) file.stream().write(static_cast<const char*>(tensors[i].data), std::streamsize(sizes[i]));
    }
    file.commit();
}

SafetensorsFile::SafetensorsFile(const std::filesystem::path& path) : path_(path) {
    if (const std::string fault = input_fault(path); !fault.empty()) fail(fault);
    std::error_code error;
    const std::uint64_t file_bytes = std::filesystem::file_size(path, error);
    if (error) fail(error.message());
    in_.open(path, std::ios::binary);
    if (!in_) fail(std::strerror(errno));
    std::uint64_t length = 0;
    if (file_bytes < sizeof length) fail(fmt::format("{} bytes are too few for a safetensors file", file_bytes));
    if (!in_.read(reinterpret_cast<char*>(&length), sizeof length)) fail("the header cannot be read");
    if (length > file_bytes - sizeof length || length > kMaxHeaderBytes) {
        fail(fmt::format("the header claims {} bytes, the file has {}: truncated, or not a safetensors file", length,
                         file_bytes));
    }
    std::string text(length, '\0');
    in_.read(text.data(), std::streamsize(length));
    if (!in_) fail("the header cannot be read");
    parse_header(text);
    data_offset_ = sizeof length + length;
    check_coverage(file_bytes - data_offset_);
}

void SafetensorsFile::parse_header(const std::string& text) {
    nlohmann::json header;
    try {
        header = parse_json(text);
    } catch (const nlohmann::json::exception& e) {
        fail(fmt::format("the header is not a JSON object: {}", e.what()));
    }
    if (!header.is_object()) fail("the header is not a JSON object");
    for (const auto& [name, entry] : header.items()) {
        if (!entry.is_object()) fail(fmt::format("header entry '{}' is not an object", name));
        if (name == "__metadata__") {
            for (const auto& [key, value] : entry.items()) {
                if (!value.is_string()) fail(fmt::format("metadata '{}' is not a string", key));
                metadata_[key] = value.get<std::string>();
            }
            continue;
        }
        Tensor tensor;
        std::uint64_t end = 0;
        try {
            const std::string dtype = entry.at("dtype").get<std::string>();
            const auto it = std::find(kDtypeNames.begin(), kDtypeNames.end(), dtype);
            if (it == kDtypeNames.end())
                fail(fmt::format("tensor '{}' has dtype '{}'; known: F32, F64, I64, U8", name, dtype));
            tensor.dtype = Dtype(it - kDtypeNames.begin());
            const auto unsigned_array = [&](const char* field) {
                std::vector<std::uint64_t> values;
                if (!entry.at(field).is_array()) fail(fmt::format("tensor '{}': '{}' is not a list", name, field));
                for (const auto& v : entry.at(field)) {
                    if (!v.is_number_unsigned())
                        fail(fmt::format("tensor '{}': '{}' holds {}, not a count", name, field, json_text(v)));
                    values.push_back(v.get<std::uint64_t>());
                }
                return values;
            };
            for (const std::uint64_t n : unsigned_array("shape")) tensor.shape.push_back(std::int64_t(n));
            const auto offsets = unsigned_array("data_offsets");
            if (offsets.size() != 2)
                fail(fmt::format("tensor '{}': data_offsets has {} values, not 2", name, offsets.size()));
            tensor.begin = offsets[0];
            end = offsets[1];
        } catch (const nlohmann::json::exception& e) {
            fail(fmt::format("tensor '{}': {}", name, e.what()));
        }
        if (end < tensor.begin)
            fail(fmt::format("tensor '{}' ends at byte {} before it begins at {}", name, end, tensor.begin));
        tensor.bytes = end - tensor.begin;
        std::uint64_t expected = 0;
        if (!tensor_bytes(tensor.dtype, tensor.shape, expected) || expected != tensor.bytes) {
            fail(fmt::format("tensor '{}' of shape ({}) and dtype {} occupies {} bytes", name,
                             fmt::join(tensor.shape, ","), kDtypeNames[std::size_t(tensor.dtype)], tensor.bytes));
        }
        tensors_[name] = std::move(tensor);
    }
}

void SafetensorsFile::check_coverage(std::uint64_t data_bytes) const {
    std::vector<const std::pair<const std::string, Tensor>*> order;
    for (const auto& entry : tensors_) order.push_back(&entry);
    // An empty tensor begins at the same offset as its neighbour and comes first.
    std::sort(order.begin(), order.end(), [](auto* a, auto* b) {
        return std::pair(a->second.begin, a->second.bytes) < std::pair(b->second.begin, b->second.bytes);
    });
    std::uint64_t end = 0;
    for (const auto* entry : order) {
        const Tensor& t = entry->second;
        if (t.begin != end)
            fail(fmt::format("tensor '{}' begins at byte {} where {} is expected: overlap or gap", entry->first,
                             t.begin, end));
        end += t.bytes;
        if (end > data_bytes)
            fail(fmt::format("tensor '{}' ends at byte {}, the file has {}: truncated", entry->first, end, data_bytes));
    }
    if (end != data_bytes) fail(fmt::format("{} bytes follow the last tensor", data_bytes - end));
}

const std::string& SafetensorsFile::metadata(const std::string& key) const {
    const auto it = metadata_.find(key);
    if (it == metadata_.end()) fail(fmt::format("metadata '{}' is missing", key));
    return it->second;
}

const SafetensorsFile::Tensor& SafetensorsFile::tensor(const std::string& name) const {
    const auto it = tensors_.find(name);
    if (it == tensors_.end()) fail(fmt::format("tensor '{}' is missing", name));
    return it->second;
}

const SafetensorsFile::Tensor& SafetensorsFile::checked(const std::string& name, Dtype dtype) const {
    const Tensor& t = tensor(name);
    if (t.dtype != dtype) {
        fail(fmt::format("tensor '{}' has dtype {}, expected {}", name, kDtypeNames[std::size_t(t.dtype)],
                         kDtypeNames[std::size_t(dtype)]));
    }
    return t;
}

void SafetensorsFile::read_bytes(const std::string& name, const Tensor& tensor, void* out) const {
    in_.clear();
    in_.seekg(std::streamoff(data_offset_ + tensor.begin));
    in_.read(static_cast<char*>(out), std::streamsize(tensor.bytes));
    if (!in_) fail(fmt::format("tensor '{}' cannot be read", name));
}

void SafetensorsFile::fail(const std::string& reason) const {
    throw DataError(fmt::format("cannot read '{}': {}", path_.string(), reason));
}

}  // namespace gs
