// SPDX-License-Identifier: Apache-2.0
// Round trips of the safetensors container, and headers that lie.
#include "lib/io/safetensors.h"

#include <cstring>
#include <random>

#include "kernels/base/error.h"
#include "tests/io/file_helpers.h"

namespace gs::test {
namespace {

std::string with_header(const std::string& json, const std::string& data = "") {
    const std::uint64_t length = json.size();
    return std::string(reinterpret_cast<const char*>(&length), 8) + json + data;
}

std::string read_error(const TempFolder& folder, const std::string& bytes) {
    spit(folder / "x.safetensors", bytes);
    const std::string message = message_of<DataError>([&] { SafetensorsFile file(folder / "x.safetensors"); });
    EXPECT_CONTAINS(message, "x.safetensors");
    return message;
}

TEST(Safetensors, RoundTripsAllTypesAndMetadata) {
    const TempFolder folder;
    const std::vector<float> f = {1, -2, 3.5f, 1e-38f, 0, 7};
    const std::vector<double> d = {0.1};
    const std::vector<std::int64_t> i = {-1, std::int64_t(1) << 60};
    const std::vector<std::uint8_t> u = {0, 128, 255};
    const std::vector<TensorView> tensors = {{"f", Dtype::kF32, {2, 3}, f.data()},
                                             {"empty", Dtype::kF32, {4, 0}, nullptr},
                                             {"u", Dtype::kU8, {3}, u.data()},
                                             {"d", Dtype::kF64, {}, d.data()},
                                             {"i", Dtype::kI64, {2, 1}, i.data()}};
    write_safetensors(folder / "a.safetensors", tensors, {{"key", "line\n\"quoted\""}});
    const SafetensorsFile file(folder / "a.safetensors");
    EXPECT_EQ(file.read<float>("f"), f);
    EXPECT_EQ(file.read<double>("d"), d);
    EXPECT_EQ(file.read<std::int64_t>("i"), i);
    EXPECT_EQ(file.read<std::uint8_t>("u"), u);
    EXPECT_TRUE(file.read<float>("empty").empty());
    EXPECT_EQ(file.tensor("f").shape, (std::vector<std::int64_t>{2, 3}));
    EXPECT_EQ(file.metadata("key"), "line\n\"quoted\"");
    EXPECT_CONTAINS(message_of<DataError>([&] { file.read<float>("none"); }), "'none' is missing");
    EXPECT_CONTAINS(message_of<DataError>([&] { file.read<float>("d"); }), "dtype F64, expected F32");
}

TEST(Safetensors, LayoutFollowsTheFormat) {
    const TempFolder folder;
    const std::vector<std::uint8_t> u = {1, 2, 3};
    const std::vector<TensorView> tensors = {{"u", Dtype::kU8, {3}, u.data()}};
    write_safetensors(folder / "a.safetensors", tensors, {});
    const std::string bytes = slurp(folder / "a.safetensors");
    std::uint64_t length = 0;
    std::memcpy(&length, bytes.data(), 8);
    EXPECT_EQ(length % 8, 0u);
    EXPECT_EQ(bytes.size(), 8 + length + 3);
    EXPECT_EQ(bytes.substr(8, 51), R"({"u":{"dtype":"U8","shape":[3],"data_offsets":[0,3])");
    EXPECT_EQ(bytes.substr(8 + length), "\1\2\3");
}

TEST(Safetensors, DamagedFilesAreNamedErrors) {
    const TempFolder folder;
    EXPECT_CONTAINS(read_error(folder, "abc"), "3 bytes");
    EXPECT_CONTAINS(read_error(folder, std::string(8, '\xff') + "{}"), "claims");
    EXPECT_CONTAINS(read_error(folder, with_header("{nonsense")), "JSON");
    EXPECT_CONTAINS(read_error(folder, with_header("[]")), "JSON");
    EXPECT_CONTAINS(read_error(folder, with_header(R"({"t":3})")), "'t'");
    EXPECT_CONTAINS(read_error(folder, with_header(R"({"__metadata__":{"a":1}})")), "metadata 'a'");
    const auto tensor = [&](const std::string& fields, const std::string& data = "abcd") {
        return read_error(folder, with_header(R"({"t":{)" + fields + "}}", data));
    };
    EXPECT_CONTAINS(tensor(R"("dtype":"BF16","shape":[2],"data_offsets":[0,4])"), "BF16");
    EXPECT_CONTAINS(tensor(R"("shape":[1],"data_offsets":[0,4])"), "dtype");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[-1],"data_offsets":[0,4])"), "-1");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[1],"data_offsets":[0])"), "data_offsets");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[1],"data_offsets":[4,0])"), "before");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[2],"data_offsets":[0,4])"), "shape (2)");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[4611686018427387905],"data_offsets":[0,4])"), "occupies 4 bytes");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[1152921504606846976],"data_offsets":[0,4611686018427387904])"),
                    "truncated");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[1],"data_offsets":[0,4])", "abc"), "truncated");
    EXPECT_CONTAINS(tensor(R"("dtype":"F32","shape":[1],"data_offsets":[0,4])", "abcde"), "follow");
    EXPECT_CONTAINS(tensor(R"("dtype":"U8","shape":[2],"data_offsets":[2,4])"), "gap");
    EXPECT_CONTAINS(
        read_error(
            folder,
            with_header(
                R"({"a":{"dtype":"U8","shape":[3],"data_offsets":[0,3]},"b":{"dtype":"U8","shape":[2],"data_offsets":[2,4]}})",
                "abcd")),
        "overlap");
    EXPECT_CONTAINS(message_of<DataError>([&] { SafetensorsFile file(folder / "absent.safetensors"); }),
                    "No such file");
}

TEST(Safetensors, MutatedHeadersNeverCrash) {
    const TempFolder folder;
    const std::vector<float> f(12, 1.0f);
    const std::vector<TensorView> tensors = {{"a", Dtype::kF32, {4, 3}, f.data()}, {"b", Dtype::kF32, {12}, f.data()}};
    write_safetensors(folder / "a.safetensors", tensors, {{"k", "v"}});
    const std::string good = slurp(folder / "a.safetensors");
    std::mt19937 random(7);
    int refused = 0;
    for (int i = 0; i < 500; ++i) {
        std::string bytes = good;
        for (int k = 0; k < 1 + i % 3; ++k) bytes[random() % bytes.size()] = char(random());
        if (i % 5 == 0) bytes.resize(random() % bytes.size());
        spit(folder / "m.safetensors", bytes);
        try {
            const SafetensorsFile file(folder / "m.safetensors");
            for (const auto& [name, tensor] : file.tensors()) {
                if (tensor.dtype != Dtype::kF32) continue;
                EXPECT_EQ(file.read<float>(name).size() * 4, tensor.bytes);
            }
        } catch (const DataError&) {
            ++refused;
        }
    }
    EXPECT_GT(refused, 150);
}

}  // namespace
}  // namespace gs::test
