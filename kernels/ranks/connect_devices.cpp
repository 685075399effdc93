// SPDX-License-Identifier: Apache-2.0
// Decides on the use of NCCL from the offers of all ranks.
#include "kernels/ranks/connect_devices.h"

#include <algorithm>

#include "kernels/base/error.h"

namespace gs {
namespace {

/// NCCL support of one rank. Texts are cut to fit.
struct Offer {
    char device[64] = {};
    char version[16] = {};   ///< version of NCCL
    char why_not[400] = {};  ///< reason why it cannot use NCCL
    NcclId id = {};          ///< id made by rank 0
};

template <std::size_t N> void put_text(char (&to)[N], const std::string& text) {
    std::copy_n(text.data(), std::min(text.size(), N - 1), to);
}

Offer own_offer(int rank, const std::string& device) {
    Offer offer;
    put_text(offer.device, device);
    if (device.empty()) return offer;
    NcclFinding found = find_nccl();
    try {
        if (rank == 0 && found.why_not.empty()) offer.id = make_nccl_id();
    } catch (const DeviceError& e) {
        found.why_not = e.what();
    }
    put_text(offer.version, found.version);
    put_text(offer.why_not, found.why_not);
    return offer;
}

std::string rank_text(std::size_t rank) { return "rank " + std::to_string(rank); }

/// Returns why the ranks cannot use NCCL together; an empty text if they can.
std::string obstacle(const std::vector<Offer>& offers) {
    for (std::size_t r = 0; r < offers.size(); ++r) {
        if (!*offers[r].device) return rank_text(r) + " has no GPU";
        for (std::size_t other = 0; other < r; ++other)
            if (std::string(offers[other].device) == offers[r].device)
                return rank_text(other) + " and " + rank_text(r) + " share a GPU";
    }
    for (std::size_t r = 0; r < offers.size(); ++r) {
        if (*offers[r].why_not) return rank_text(r) + ": " + offers[r].why_not + "; get it: " + kGetNccl;
        if (std::string(offers[r].version) != offers[0].version)
            return rank_text(r) + " has NCCL " + offers[r].version + ", rank 0 has " + offers[0].version +
                   "; GSAPP_NCCL=path of libnccl.so.2 names another";
    }
    return "";
}

}  // namespace

std::string connect_devices(Communicator& ranks, const std::string& device) {
    const std::vector<Offer> offers = all_gather(ranks, own_offer(ranks.rank(), device));
    if (std::none_of(offers.begin(), offers.end(), [](const Offer& offer) { return *offer.device; })) return "";
    if (const std::string why_not = obstacle(offers); !why_not.empty()) return why_not;
    try {
        ranks.use(connect_by_nccl(ranks, offers[0].id));
    } catch (const DeviceError& e) {
        throw DeviceError(std::string(e.what()) + "; GSAPP_NCCL=off does without NCCL");
    }
    return "";
}

}  // namespace gs
