// SPDX-License-Identifier: Apache-2.0
// Reads and writes safetensors files: an 8-byte header length, a JSON header, then the tensors packed one by one.
// Format: https://huggingface.co/docs/safetensors (little endian, row-major).
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

enum class Dtype : int { kF32, kF64, kI64, kU8 };

template <class T> inline constexpr Dtype kDtypeOf = Dtype::kU8;
template <> inline constexpr Dtype kDtypeOf<float> = Dtype::kF32;
template <> inline constexpr Dtype kDtypeOf<double> = Dtype::kF64;
template <> inline constexpr Dtype kDtypeOf<std::int64_t> = Dtype::kI64;

/// A tensor in memory to be written. The data is borrowed until the write returns.
struct TensorView {
    std::string name;
    Dtype dtype = Dtype::kF32;
    std::vector<std::int64_t> shape;
    const void* data = nullptr;
};

/// Writes all tensors atomically, in the given order and without copying them. Throws DataError if the write fails or a
/// shape is impossible.
void write_safetensors(const std::filesystem::path& path, std::span<const TensorView> tensors,
                       const std::map<std::string, std::string>& metadata);

/// An opened safetensors file. The constructor reads and checks only the header: its length against the file's, every
/// dtype, shape and byte range. The ranges must cover the data without gap or overlap. Throws DataError naming file,
/// tensor and value; sizes in a damaged header never lead to an allocation.
class SafetensorsFile {
  public:
    struct Tensor {
        Dtype dtype = Dtype::kF32;
        std::vector<std::int64_t> shape;
        std::uint64_t begin = 0, bytes = 0;  ///< byte range within the data section
    };

    explicit SafetensorsFile(const std::filesystem::path& path);

    const std::map<std::string, std::string>& metadata() const { return metadata_; }
    const std::map<std::string, Tensor>& tensors() const { return tensors_; }
    /// Returns one entry. Throws DataError if the file has no such entry.
    const std::string& metadata(const std::string& key) const;
    const Tensor& tensor(const std::string& name) const;

    /// Reads one tensor. T is float, double, int64 or uint8 and must be the stored type. Throws DataError.
    template <class T> std::vector<T> read(const std::string& name) const {
        const Tensor& t = checked(name, kDtypeOf<T>);
        std::vector<T> values(t.bytes / sizeof(T));
        read_bytes(name, t, values.data());
        return values;
    }

  private:
    const Tensor& checked(const std::string& name, Dtype dtype) const;
    void read_bytes(const std::string& name, const Tensor& tensor, void* out) const;
    [[noreturn]] void fail(const std::string& reason) const;
    void parse_header(const std::string& text);
    void check_coverage(std::uint64_t data_bytes) const;

    std::filesystem::path path_;
    mutable std::ifstream in_;
    std::uint64_t data_offset_ = 0;
    std::map<std::string, std::string> metadata_;
    std::map<std::string, Tensor> tensors_;
};

}  // namespace gs
