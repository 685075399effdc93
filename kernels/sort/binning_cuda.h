// SPDX-License-Identifier: Apache-2.0
// Sorts Gaussians by depth, then their instances stably by tile, on the device (docs/math/rasterizer.md#sorting).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "kernels/cuda/device_memory.h"
#include "kernels/splat/depth_key.h"
#include "kernels/splat/splat_cuda.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

inline constexpr int kSweepBlock = 256, kSweepItems = 16, kSweepPairs = kSweepBlock * kSweepItems;

/// Number of blocks whose sums are also added up in one group word (BlockSums). With 16, a few hundred blocks form
/// about as many groups as a group has blocks, so a block reads few words of each kind.
inline constexpr int kBlocksOfGroup = 16;
/// Returns the number of words through which blocks exchange their sums in `columns` columns.
constexpr std::size_t block_sums(std::size_t blocks, int columns) {
    return (blocks + blocks / kBlocksOfGroup) * std::size_t(columns);
}

/// The passes of a sort.
struct DigitPlan {
    int passes, bits;  ///< bits of a digit: 7 or 8

    /// Returns the plan for keys of up to 32 bits. Fewer digits mean fewer sums to exchange between blocks.
    static constexpr DigitPlan of(int key_bits) {
        return key_bits <= 14 ? DigitPlan{2, 7} : DigitPlan{(key_bits + 7) / 8, 8};
    }
    constexpr int digits() const { return 1 << bits; }
    /// Returns the number of counts of all passes.
    constexpr int counts() const { return passes << bits; }
    /// Returns the number of words through which the blocks of one pass exchange their sums.
    std::size_t sums(std::int64_t pairs) const {
        return block_sums(std::size_t(pairs + kSweepPairs - 1) / kSweepPairs, digits());
    }
};

/// Value next to a depth key that represents this many touched tiles or more.
inline constexpr std::uint32_t kManyTiles = 0xff;

/// Numbers of tiles touched by parts of the depth order, from which instances get their places. They are summed up
/// while the order is written. Larger groups make more atomics wait for one address; smaller groups give each block
/// more words to add up.
struct ChunkSums {
    static constexpr std::uint32_t kPairs = 512, kChunksOfGroup = 4;

    const std::uint32_t* tiles = nullptr;  ///< (n) touched tiles of each Gaussian
    std::uint32_t* of_chunks = nullptr;    ///< one per kPairs Gaussians, initially 0; null: no sums
    std::uint32_t* of_groups = nullptr;    ///< one per kChunksOfGroup chunks, initially 0
};

/// The arrays that preprocessing fills and binning sorts, (n) each. If nothing is sorted, only the counts exist.
struct CudaBinningInput {
    std::uint32_t* depth_keys;  ///< count (at most kManyTiles) above the kDepthKeyBits of the depth; 0: culled
    TileSpan* spans;
    std::uint32_t* counts;   ///< number of touched tiles; 0 = culled
    std::span<uint4> zeros;  ///< counters of the sort, zeroed by the kernel that fills the arrays
};

/// The sort on the device.
class CudaBinning {
  public:
    /// Takes only the counts of `input`, for splats that another rank sorts.
    void take_counts(Carver& c, std::int64_t n) { input_ = {.counts = c.take<std::uint32_t>(n)}; }
    /// Takes the buffers that outlive binning, and those that are written before it.
    void take_results(Carver& c, std::int64_t n, std::int64_t capacity, int width, int height, bool keep_slots);
    /// Takes the rest of `input`, and then the buffers used only by binning. Returns the offset of the latter, which
    /// are not written before build().
    std::size_t take_temporaries(Carver& c);

    const CudaBinningInput& input() const { return input_; }
    /// Counts the view's visible Gaussians and instances, and sorts at most `room` instances, which must not exceed the
    /// capacity. If there are more, it writes none and sets control->stopped. Its last kernel leaves most of the device
    /// idle, so it also sets `to_clear` to 0, which may overlap the temporaries.
    CudaBins build(const PackedSplat* splats, std::int64_t room, std::span<uint4> to_clear, StepControl* control,
                   cudaStream_t stream);
    /// Returns the sorted instances of the last build().
    const CudaBins& bins() const { return bins_; }
    SlotMap slots() const { return {order_, ends_}; }

  private:
    /// Counters and sums of a sort, all initially 0.
    struct Counts {
        std::uint32_t *depth_digits = nullptr, *tile_digits = nullptr;
        ChunkSums chunk_sums;
        std::uint32_t* tile_begins = nullptr;                       ///< (tiles+1), ~ of the first instance of each tile
        std::uint32_t *depth_sums = nullptr, *tile_sums = nullptr;  ///< sums exchanged between blocks
        std::size_t words = 0;
    };
    template <class Key>
    void sort_instances(const PackedSplat* splats, std::int64_t room, std::span<uint4> to_clear, StepControl* control,
                        const Counts& counts, cudaStream_t stream);
    DigitPlan tile_plan() const;
    Counts counts_for(std::int64_t instances) const;

    std::int64_t n_ = 0, capacity_ = 0;
    CudaBins bins_;
    bool keep_slots_ = false;
    CudaBinningInput input_{};
    uint2* large_ = nullptr;  ///< large and huge Gaussians (InstanceLists); earlier, pairs of the depth sort
    std::uint32_t *order_ = nullptr, *ends_ = nullptr, *gaussians_ = nullptr, *sorted_ = nullptr, *other_ = nullptr,
                  *tile_offsets_ = nullptr;
    std::uint32_t* tile_keys_[2] = {};  ///< with 16-bit keys if these suffice
    TileItem* longest_first_ = nullptr;
};

}  // namespace gs
