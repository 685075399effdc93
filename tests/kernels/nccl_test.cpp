// SPDX-License-Identifier: Apache-2.0
// Finding NCCL, agreeing on it, and exchanging arrays of devices by it. No GPU is needed: devices are memory of the
// host, and NCCL is fake_nccl, but where a test says otherwise.
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/ranks/connect_devices.h"
#include "tests/kernels/fake_device_stream.h"
#include "tests/kernels/rank_threads.h"

namespace gs::test {
namespace {

/// Sets an environment variable for the time of a test.
class Variable {
  public:
    Variable(const char* name, const std::string& value) : name_(name) { ::setenv(name, value.c_str(), 1); }
    ~Variable() { ::unsetenv(name_); }

  private:
    const char* name_;
};

class Nccl : public ::testing::Test {
  protected:
    void SetUp() override {
#ifndef FAKE_NCCL_LIBRARY
        GTEST_SKIP() << "this build has no NCCL: " << find_nccl().why_not;
#endif
    }
#ifdef FAKE_NCCL_LIBRARY
    const std::string fake = FAKE_NCCL_LIBRARY;
#else
    const std::string fake;
#endif
    /// Calls a counter of the fake library, which the test has loaded.
    int count(const char* counter) const {
        void* const handle = ::dlopen(fake.c_str(), RTLD_NOW | RTLD_NOLOAD);
        if (!handle) return 0;
        const auto function = reinterpret_cast<int (*)()>(::dlsym(handle, counter));
        const int value = function();
        ::dlclose(handle);
        return value;
    }
    /// Returns why two ranks do not use NCCL together.
    std::string obstacle(const std::string& device_0, const std::string& device_1) const {
        std::string why_not;
        on_ranks(2, [&](Communicator& ranks) {
            const std::string text = connect_devices(ranks, ranks.rank() == 0 ? device_0 : device_1);
            EXPECT_EQ(ranks.link(), nullptr);
            if (ranks.rank() == 0) why_not = text;
        });
        return why_not;
    }
    /// Returns the error of an exchange on two ranks, or of what comes before it.
    std::string error() const {
        try {
            on_ranks(2, [&](Communicator& ranks) {
                EXPECT_EQ(connect_devices(ranks, std::to_string(ranks.rank())), "");
                FakeDevice device;
                expect_exchanged(ranks, &device);
            });
        } catch (const DeviceError& e) {
            return e.what();
        }
        return "";
    }
};

TEST_F(Nccl, IsFoundWhereTheVariableSays) {
    const Variable chosen("GSAPP_NCCL", fake);
    const NcclFinding found = find_nccl();
    EXPECT_EQ(found.version, "2.99.1");
    EXPECT_EQ(std::filesystem::path(found.path), std::filesystem::path(fake));
    EXPECT_EQ(found.why_not, "");
}

TEST_F(Nccl, IsNotFoundWithAReason) {
    const auto reason = [](const std::string& place) {
        const Variable chosen("GSAPP_NCCL", place);
        const NcclFinding found = find_nccl();
        EXPECT_EQ(found.version, "");
        return found.why_not;
    };
    EXPECT_NE(reason("/nowhere/libnccl.so.2").find("/nowhere/libnccl.so.2"), std::string::npos);
    const auto text_file = std::filesystem::temp_directory_path() / ("gsapp-no-library-" + std::to_string(::getpid()));
    std::ofstream(text_file) << "this is no library, and long enough to be read as one: " << std::string(100, '.');
    EXPECT_NE(reason(text_file).find("NCCL was not found"), std::string::npos) << reason(text_file);
    std::filesystem::remove(text_file);
    EXPECT_NE(reason("libm.so.6").find("libm.so.6 has no ncclGetVersion"), std::string::npos) << reason("libm.so.6");
    EXPECT_EQ(reason("off"), "GSAPP_NCCL=off");
    const Variable fault("FAKE_NCCL", "ncclGetVersion");
    EXPECT_EQ(reason(fake), "ncclGetVersion: internal error (details of the error)");
}

TEST_F(Nccl, OfThisMachineHasAllFunctions) {
    const NcclFinding found = find_nccl();
    if (!found.why_not.empty()) GTEST_SKIP() << found.why_not;
    EXPECT_TRUE(std::filesystem::exists(found.path)) << found.path;
    EXPECT_EQ(found.version.substr(0, 2), "2.");
}

TEST_F(Nccl, IsLeftAloneWhereARankCannotUseIt) {
    const Variable chosen("GSAPP_NCCL", fake);
    EXPECT_EQ(obstacle("", ""), "") << "nobody has a device";
    EXPECT_EQ(obstacle("a", ""), "rank 1 has no GPU");
    EXPECT_EQ(obstacle("a", "a"), "rank 0 and rank 1 share a GPU");
    const Variable fault("FAKE_NCCL", "ncclGetUniqueId");
    EXPECT_EQ(obstacle("a", "b").find("rank 0: ncclGetUniqueId: internal error"), 0u) << obstacle("a", "b");
    const Variable nowhere("GSAPP_NCCL", "/nowhere/libnccl.so.2");
    const std::string missing = obstacle("a", "b");
    EXPECT_EQ(missing.find("rank 0: NCCL was not found (/nowhere/libnccl.so.2"), 0u) << missing;
    EXPECT_NE(missing.find("apt-get install libnccl2"), std::string::npos) << missing;
}

TEST_F(Nccl, SendsArraysFromDeviceToDevice) {
    const Variable chosen("GSAPP_NCCL", fake);
    const int before = count("fake_nccl_destroys");
    for (const int size : {1, 2, 3}) {
        on_ranks(size, [&](Communicator& ranks) {
            EXPECT_EQ(connect_devices(ranks, std::to_string(ranks.rank())), "");
            ASSERT_NE(ranks.link(), nullptr);
            EXPECT_EQ(ranks.link()->name(), "NCCL 2.99.1");
            const Traffic begin = ranks.traffic();
            expect_exchanged(ranks, nullptr);
            const Traffic of_host = ranks.traffic() - begin;
            FakeDevice device;
            for (int k = 0; k < 3; ++k) expect_exchanged(ranks, &device);
            const Traffic all = ranks.traffic() - begin;
            EXPECT_EQ(all.sent, 4 * of_host.sent);
            EXPECT_EQ(all.messages, 4 * of_host.messages);
            EXPECT_EQ(all.device_exchanges, 3);
        });
    }
    EXPECT_EQ(count("fake_nccl_destroys"), before + 6) << "every rank takes its leave";
}

TEST_F(Nccl, SaysInItsOwnWordsWhatFailed) {
    const Variable chosen("GSAPP_NCCL", fake);
    for (const std::string function : {"ncclCommInitRankConfig", "ncclSend", "ncclRecv", "ncclGroupEnd"}) {
        const Variable fault("FAKE_NCCL", function);
        EXPECT_EQ(error().find(function + ": internal error (details of the error)"), 0u) << error();
    }
    const Variable fault("FAKE_NCCL", "async");
    EXPECT_EQ(error(), "NCCL: remote process exited (details of the error)");
}

/// Calls wait() on a rank of two, and expects that it throws when another thread ends the connection.
template <class Wait> void expect_abortable(Communicator& ranks, Wait&& wait) {
    std::thread watch([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
        ranks.abort();
    });
    const double start = seconds_now();
    try {
        wait();
        ADD_FAILURE() << "nobody answers";
    } catch (const DeviceError& e) {
        EXPECT_NE(std::string(e.what()).find("was ended"), std::string::npos) << e.what();
    }
    EXPECT_LT(seconds_now() - start, 10);
    watch.join();
}

TEST_F(Nccl, EndsAnExchangeThatWaitsForALostRank) {
    const Variable chosen("GSAPP_NCCL", fake);
    const int before = count("fake_nccl_aborts");
    on_ranks(2, [&](Communicator& ranks) {
        EXPECT_EQ(connect_devices(ranks, std::to_string(ranks.rank())), "");
        if (ranks.rank() == 1) return;  // is lost
        FakeDevice device;
        DeviceArray<float> array(&device);
        array.resize(10);
        const auto exchange = [&] { ranks.exchange({{}, array.bytes()}, {{}, array.bytes()}, &device); };
        expect_abortable(ranks, exchange);
        EXPECT_EQ(count("fake_nccl_aborts"), before + 1);
        EXPECT_THROW(exchange(), DeviceError) << "nothing more is sent";
    });
}

TEST_F(Nccl, EndsAConnectionThatWaitsForALostRank) {
    const Variable chosen("GSAPP_NCCL", fake);
    on_ranks(2, [&](Communicator& ranks) {
        if (ranks.rank() == 1) return;  // is lost
        expect_abortable(ranks, [&] { connect_by_nccl(ranks, make_nccl_id()); });
    });
}

}  // namespace
}  // namespace gs::test
