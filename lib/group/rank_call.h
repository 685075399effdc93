// SPDX-License-Identifier: Apache-2.0
// Requests from one rank to another over TCP, with the proof that both belong to the same job. The answering rank first
// sends a random number. Request and answer carry an HMAC-SHA256, keyed with the job's secret, over their content and
// the random numbers of both sides. So no other process can send valid requests or answers, and a recorded request
// cannot be replayed.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "kernels/base/descriptor.h"

namespace gs {

/// The data that distinguish the ranks of a job from all other processes.
struct Credentials {
    std::string secret;  ///< secret shared only by the ranks (shared_secret)
    std::string job;     ///< identification of the job, because other jobs of the same user may have the same secret
};

struct RankRequest {
    enum class Call : std::uint8_t { kSet, kGet, kReport, kFail, kConnect };
    Call call = Call::kReport;
    int rank = 0;  ///< rank that sends the request
    std::string key, value;
};

struct RankAnswer {
    enum class Status : std::uint8_t {
        kOk,
        kNotYet,    ///< the value is not set yet
        kFailed,    ///< the job has failed; `value` is the reason
        kOtherJob,  ///< the answering rank belongs to another job with the same secret
        kRefused    ///< the requesting rank does not have the secret
    };
    Status status = Status::kOk;
    std::string value;
};

/// The address at which a rank listens.
struct RankAddress {
    int rank = 0;
    std::string host;
    int port = 0;
};

/// The time within which a rank answers, and after which it drops an unfinished request, in seconds.
inline constexpr double kAnswerSeconds = 10;

/// Sends a request to a rank and returns its answer. Retries for `patience` seconds while the rank cannot be reached.
/// If `connection` is not null, the connection stays open and is stored there. Throws DeviceError if the rank cannot be
/// reached, belongs to another job or has another secret.
RankAnswer ask(const RankAddress& address, const RankRequest& request, const Credentials& credentials, double patience,
               Descriptor* connection = nullptr);

/// The largest size of a request or answer in bytes, without its header and proof. Options and messages are much
/// shorter.
inline constexpr std::size_t kLongestCall = std::size_t(1) << 20;

/// The answering rank's side of one request: decodes the request and encodes the answer.
class AnsweringSide {
  public:
    explicit AnsweringSide(const Credentials& credentials);
    /// Returns the greeting, which is sent first.
    std::string greeting() const;
    /// Returns the number of bytes of the request still to be read after `received`, or until its size is known a lower
    /// bound; 0 if the request is complete. Throws DeviceError if `received` is not a request.
    static std::size_t missing(std::string_view received);
    /// Decodes a complete request. Returns nothing if its proof is wrong.
    std::optional<RankRequest> open(std::string_view received);
    /// Returns whether the opened request belongs to another job.
    bool is_of_other_job() const { return other_job_; }
    /// Returns the encoded answer with its proof. An answer with status kRefused has no proof.
    std::string seal(const RankAnswer& answer) const;

  private:
    const Credentials& credentials_;
    std::string nonces_;  ///< random number of this side and, after open(), of the other
    bool other_job_ = false;
};

}  // namespace gs
