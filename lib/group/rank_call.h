// SPDX-License-Identifier: Apache-2.0
// Requests from one rank to another over TCP, and the proof that both are of the same job. The rank that answers greets
// with a random number; request and answer carry an HMAC-SHA256, keyed with the job's secret, over themselves and over
// the random numbers of both sides. So nobody else can ask or answer, and a recorded request is worth nothing later.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "kernels/base/descriptor.h"

namespace gs {

/// Facts that tell the ranks of a job from everybody else.
struct Credentials {
    std::string secret;  ///< nobody else knows it (shared_secret)
    std::string job;     ///< what they were started for; other jobs of the same user may have the same secret
};

struct RankRequest {
    enum class Call : std::uint8_t { kSet, kGet, kReport, kFail, kConnect };
    Call call = Call::kReport;
    int rank = 0;  ///< that asks
    std::string key, value;
};

struct RankAnswer {
    enum class Status : std::uint8_t {
        kOk,
        kNotYet,    ///< there is no such value yet
        kFailed,    ///< the job has failed; the value says why
        kOtherJob,  ///< the rank is of another job with the same secret
        kRefused    ///< the asker does not know the secret
    };
    Status status = Status::kOk;
    std::string value;
};

/// Where a rank listens.
struct RankAddress {
    int rank = 0;
    std::string host;
    int port = 0;
};

/// A rank answers within so many seconds, and drops who does not finish a request within them.
inline constexpr double kAnswerSeconds = 10;

/// Asks a rank, tries for `patience` seconds to reach it, and returns its answer. With `connection` the connection is
/// left open there. Throws DeviceError when the rank cannot be reached, is of another job or has another secret.
RankAnswer ask(const RankAddress& address, const RankRequest& request, const Credentials& credentials, double patience,
               Descriptor* connection = nullptr);

/// The longest request or answer in bytes, its proof included. Options and messages are much shorter.
inline constexpr std::size_t kLongestCall = std::size_t(1) << 20;

/// One request and its answer as bytes, on the side of the rank that answers.
class AnsweringSide {
  public:
    explicit AnsweringSide(const Credentials& credentials);
    /// Returns what is sent first.
    std::string greeting() const;
    /// Returns how many more bytes of the request must be read after these; 0 if it is complete. Throws DeviceError
    /// when this is no request.
    static std::size_t missing(std::string_view received);
    /// Reads a complete request. Returns nothing if its proof is wrong.
    std::optional<RankRequest> open(std::string_view received);
    /// Returns whether the request that was opened is of another job.
    bool is_of_other_job() const { return other_job_; }
    /// Returns the answer with its proof. One that refuses has none.
    std::string seal(const RankAnswer& answer) const;

  private:
    const Credentials& credentials_;
    std::string nonces_;  ///< of this side and, after open(), of the other
    bool other_job_ = false;
};

}  // namespace gs
