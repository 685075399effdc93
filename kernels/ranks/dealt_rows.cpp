// SPDX-License-Identifier: Apache-2.0
// Deals the rows of a model to ranks, and joins them again.
#include "kernels/ranks/dealt_rows.h"

#include <algorithm>
#include <array>

#include "kernels/base/parallel.h"

namespace gs {
namespace {

/// Returns the arrays of a group, which share one layout.
template <class Group> auto arrays_of(Group& group) { return std::array{&group.param, &group.m, &group.v}; }

/// An array of which each part of a model holds some or all of its rows.
struct ArrayOfParts {
    int width;
    std::vector<const std::vector<float>*> from;  ///< source array of each part
    std::vector<float>* to;
};

/// Joins the rows in order, leaving out the rows that a part does not hold.
void join(const ArrayOfParts& array, const std::vector<DealtRow>& order) {
    std::size_t size = 0;
    for (const auto* from : array.from) size += from->size();
    array.to->reserve(size);
    for (const DealtRow& place : order) {
        const std::vector<float>& from = *array.from[std::size_t(place.rank)];
        const std::size_t at = std::size_t(place.row) * array.width;
        if (at < from.size()) array.to->insert(array.to->end(), from.begin() + at, from.begin() + at + array.width);
    }
}

}  // namespace

std::vector<DealtRow> row_order(const std::vector<RowCounts>& ranks) {
    std::vector<DealtRow> order;
    std::int64_t longest = 0, total = 0;
    for (const RowCounts& r : ranks) longest = std::max(longest, r.count), total += r.count;
    order.reserve(std::size_t(total));
    for (const bool with_residual : {true, false})
        for (std::int64_t row = 0; row < longest; ++row)
            for (std::size_t rank = 0; rank < ranks.size(); ++rank)
                if (row < ranks[rank].count && (row < ranks[rank].num_residuals) == with_residual)
                    order.push_back({int(rank), std::uint32_t(row)});
    return order;
}

Gaussians dealt_part(const Gaussians& model, int ranks, int rank) {
    Gaussians part;
    part.count = dealt_count(model.count, ranks, rank);
    part.appearance = model.appearance, part.active_degree = model.active_degree, part.step = model.step;
    part.antialiased = model.antialiased, part.shared = model.shared, part.ppisp = model.ppisp;
    const auto deal = [&](const std::vector<float>& from, int width, std::vector<float>& to) {
        if (from.empty() || width == 0) return;
        const std::int64_t rows = std::int64_t(from.size()) / width;
        to.reserve(std::size_t(dealt_count(rows, ranks, rank)) * width);
        for (std::int64_t row = rank; row < rows; row += ranks)
            to.insert(to.end(), from.begin() + row * width, from.begin() + (row + 1) * width);
    };
    for (int g = 0; g < kNumGroups; ++g) {
        const auto& from = model.groups[g];
        auto& to = part.groups[g];
        to.width = from.width;
        for (int k = 0; k < 3; ++k) deal(*arrays_of(from)[k], from.width, *arrays_of(to)[k]);
    }
    deal(model.gradient_sum, 1, part.gradient_sum);
    deal(model.gradient_count, 1, part.gradient_count);
    deal(model.last_step, 1, part.last_step);
    return part;
}

Gaussians joined(const std::vector<Gaussians>& parts) {
    Gaussians model;
    const Gaussians& first = parts.front();
    model.appearance = first.appearance, model.active_degree = first.active_degree, model.step = first.step;
    model.antialiased = first.antialiased, model.shared = first.shared, model.ppisp = first.ppisp;
    std::vector<RowCounts> rows;
    for (const Gaussians& part : parts) {
        rows.push_back({part.count, part.num_residuals()});
        model.count += part.count;
    }
    const std::vector<DealtRow> order = row_order(rows);
    std::vector<ArrayOfParts> arrays;
    const auto add = [&](int width, std::vector<float>& to, auto&& array_of) {
        if (width == 0) return;
        arrays.push_back({width, {}, &to});
        for (const Gaussians& part : parts) arrays.back().from.push_back(&array_of(part));
    };
    for (int g = 0; g < kNumGroups; ++g) {
        const int width = model.groups[g].width = first.groups[g].width;
        for (int k = 0; k < 3; ++k)
            add(
                width, *arrays_of(model.groups[g])[k], [&](const Gaussians& part) -> const auto& {
                    return *arrays_of(part.groups[g])[k];
                });
    }
    // A rank without rows gathers no statistic. If another rank gathers one, the empty part is still correct.
    add(
        1, model.gradient_sum, [](const Gaussians& part) -> const auto& { return part.gradient_sum; });
    add(
        1, model.gradient_count, [](const Gaussians& part) -> const auto& { return part.gradient_count; });
    add(
        1, model.last_step, [](const Gaussians& part) -> const auto& { return part.last_step; });
    parallel_for(std::int64_t(arrays.size()), [&](std::int64_t k) { join(arrays[std::size_t(k)], order); });
    return model;
}

std::vector<std::int64_t> even_shares(const std::vector<RowCounts>& ranks, std::int64_t total) {
    std::vector<std::int64_t> shares(ranks.size(), 0);
    std::vector<bool> full;
    for (const RowCounts& r : ranks) full.push_back(r.count == 0);  // a rank without rows cannot grow
    for (bool again = true; again;) {
        again = false;
        std::int64_t rest = total;
        int open = 0, at = 0;
        for (std::size_t r = 0; r < ranks.size(); ++r) full[r] ? void(rest -= shares[r]) : void(++open);
        for (std::size_t r = 0; r < ranks.size(); ++r)
            if (!full[r]) shares[r] = dealt_count(std::max<std::int64_t>(0, rest), open, at++);
        for (std::size_t r = 0; r < ranks.size(); ++r)
            if (!full[r] && shares[r] < ranks[r].count) {
                shares[r] = ranks[r].count;
                full[r] = true;
                again = true;
            }
    }
    return shares;
}

}  // namespace gs
