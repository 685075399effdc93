// SPDX-License-Identifier: Apache-2.0
// Merges lists that are in order already.
#include "kernels/ranks/splat_order.h"

#include <algorithm>
#include <compare>

namespace gs {
namespace {

/// The place of a splat in row_order(): with a residual or without, row, rank.
struct Place {
    bool plain;
    std::uint32_t row, rank, at;
    auto operator<=>(const Place&) const = default;
};

}  // namespace

void order_on_host(const SplatParts& splats, const RowParts& rows, const std::vector<RankRows>& of_ranks,
                   RankArray<WireSplat>& out) {
    const std::size_t num_parts = splats.size();
    std::vector<Place> places;
    std::vector<std::size_t> begin = {0};
    std::vector<std::vector<WireSplat>> copied_splats(num_parts);
    std::vector<std::span<const WireSplat>> values;
    for (std::size_t r = 0; r < num_parts; ++r) {
        std::vector<std::uint32_t> copied_rows;
        const auto rows_of_part = rows[r].on_host(copied_rows);
        values.push_back(splats[r]->on_host(copied_splats[r]));
        for (std::size_t i = 0; i < rows_of_part.size(); ++i)
            places.push_back(
                {rows_of_part[i] >= of_ranks[r].num_residuals, rows_of_part[i], std::uint32_t(r), std::uint32_t(i)});
        begin.push_back(places.size());
    }
    const auto at = [&](std::size_t part) { return places.begin() + std::ptrdiff_t(begin[std::min(part, num_parts)]); };
    for (std::size_t merged = 1; merged < num_parts; merged *= 2)
        for (std::size_t r = 0; r < num_parts; r += 2 * merged)
            std::inplace_merge(at(r), at(r + merged), at(r + 2 * merged));
    std::vector<WireSplat> ordered;
    ordered.reserve(places.size());
    for (const Place& place : places) ordered.push_back(values[place.rank][place.at]);
    out.assign(ordered);
}

}  // namespace gs
