// SPDX-License-Identifier: Apache-2.0
// Keeps the roster, and asks rank 0 for it.
#include "lib/group/roster.h"

#include <fmt/format.h>

#include <chrono>
#include <utility>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/group/secret.h"

namespace gs {
namespace {

/// The longest pause between two looks at the ranks, seconds; in a longer one this process did not run.
constexpr double kLongestPause = 3;

}  // namespace

Roster::Roster(int size) : heard_(std::size_t(size)), start_(seconds_now()), last_look_(start_) {}

void Roster::set(const std::string& key, const std::vector<char>& value) {
    const std::lock_guard lock(mutex_);
    values_[key] = value;
    changed_.notify_all();
}

std::optional<std::vector<char>> Roster::get(const std::string& key, double seconds) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                      [&] { return !failure_.empty() || values_.contains(key); });
    if (!failure_.empty() || !values_.contains(key)) return std::nullopt;
    return values_[key];
}

void Roster::hear_of(int rank, const std::string& host) {
    const std::lock_guard lock(mutex_);
    if (rank >= 0 && rank < int(heard_.size())) heard_[std::size_t(rank)] = {seconds_now(), host};
}

void Roster::fail(const std::string& message) {
    const std::lock_guard lock(mutex_);
    if (failure_.empty()) failure_ = message;
    changed_.notify_all();
}

std::string Roster::failure() const {
    const std::lock_guard lock(mutex_);
    return failure_;
}

void Roster::look_for_lost_ranks() {
    std::string message;
    {
        const std::lock_guard lock(mutex_);
        const double now = seconds_now();
        // While this process was stopped, or its machine asleep, it heard of nobody.
        if (std::exchange(last_look_, now) + kLongestPause < now)
            for (Heard& heard : heard_) heard.seconds = heard.seconds > 0 ? now : 0;
        for (std::size_t r = 1; r < heard_.size(); ++r) {
            const Heard& heard = heard_[r];
            if (heard.seconds == 0 && now - start_ > kLongestWait)
                message = fmt::format(
                    "rank {} of {} did not come within {:g} s: it was not started, cannot reach this machine, or has "
                    "another secret ({})",
                    r, heard_.size(), kLongestWait, kSecretVariable);
            else if (heard.seconds > 0 && now - heard.seconds > kLongestSilence)
                message = fmt::format("rank {} on {} has not been heard of for {:g} s: it hangs, or its machine does",
                                      r, heard.host, kLongestSilence);
        }
    }
    if (!message.empty()) fail(message);
}

RankPort::Handler answers_of(Roster& roster) {
    return [&roster](const RankRequest& request) -> std::optional<RankAnswer> {
        using Call = RankRequest::Call;
        if (request.call == Call::kSet) roster.set(request.key, {request.value.begin(), request.value.end()});
        if (request.call == Call::kReport) roster.hear_of(request.rank, request.value);
        if (request.call == Call::kFail) roster.fail(request.value);
        if (std::string failure = roster.failure(); !failure.empty())
            return RankAnswer{RankAnswer::Status::kFailed, std::move(failure)};
        if (request.call != Call::kGet) return RankAnswer{};
        const auto value = roster.get(request.key, 0);
        if (!value) return std::nullopt;
        return RankAnswer{RankAnswer::Status::kOk, {value->begin(), value->end()}};
    };
}

RankAnswer RosterClient::ask_rank_0(RankRequest::Call call, const std::string& key, const std::string& value,
                                    double patience) const {
    return ask(address_, {call, rank_, key, value}, credentials_, patience);
}

void RosterClient::set(const std::string& key, const std::vector<char>& value) {
    ask_rank_0(RankRequest::Call::kSet, key, {value.begin(), value.end()}, kLongestSilence);
}

std::vector<char> RosterClient::get(const std::string& key) {
    while (true) {
        const RankAnswer answer = ask_rank_0(RankRequest::Call::kGet, key, "", kLongestSilence);
        if (answer.status == RankAnswer::Status::kOk) return {answer.value.begin(), answer.value.end()};
        if (answer.status == RankAnswer::Status::kFailed) throw DeviceError(answer.value);
    }
}

std::string RosterClient::report(const std::string& host, double patience) {
    const RankAnswer answer = ask_rank_0(RankRequest::Call::kReport, "", host, patience);
    return answer.status == RankAnswer::Status::kFailed ? answer.value : "";
}

void RosterClient::fail(const std::string& message) { ask_rank_0(RankRequest::Call::kFail, "", message, 0); }

}  // namespace gs
