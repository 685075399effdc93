// SPDX-License-Identifier: Apache-2.0
// Splats sent between ranks: packed by the rank that projects them, unpacked by the rank that renders them. Only .cu
// files include this header.
#pragma once

#include <vector>

#include "kernels/blend/blend_cuda.h"
#include "kernels/sort/binning_cuda.h"
#include "kernels/splat/gaussian_rows_device.h"
#include "kernels/splat/splat_order.h"
#include "kernels/splat/view_report.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// Room for the splats of a view on the device.
struct WireSplats {
    WireSplat* splats;    ///< (room)
    std::uint32_t* rows;  ///< (room) rows of the splats, or null
    SplatPlaces* places;  ///< (n / 32, rounded up) places of the rows' splats, initially 0; or null
    std::int64_t room;
    ViewReport* report;  ///< null: no report
};

/// Packs the splats of `*num` Gaussians with these `rows`, as ViewRenderer::end_projection describes. Pointers are on
/// the device.
void pack_splats(const std::uint32_t* rows, const std::int64_t* num, const ParameterView<float>& params,
                 const CameraParams<float>& camera, const PackedSplat* splats, const PackedLensShape* lens_shapes,
                 const WireSplats& out, cudaStream_t stream);

/// A view of splats from all ranks.
struct WireView {
    CameraParams<float> camera;
    int width_padded, height_padded;  ///< to whole tiles
    DepthKey depth_key;
    float inverse_alpha;  ///< as in Cutoffs
};

/// Unpacks `num` splats, with all input of binning, from place `first` of the view on; through a lens their shapes,
/// too. Zeroes the counters of the view, even if only some parts of it are unpacked so far.
void unpack_splats(const WireSplat* wire, std::int64_t num, std::int64_t first, const WireView& view,
                   PackedSplat* splats, PackedLensShape* lens_shapes, const CudaBinningInput& out, StepControl* control,
                   cudaStream_t stream);

/// Writes the splats of all ranks in the order of row_order(). `parts` is passed both on the host and on the device.
void merge_splats(const std::vector<SplatsOfRank>& parts, const SplatsOfRank* parts_on_device, WireSplat* out,
                  cudaStream_t stream);

/// Writes sums in the format for sending.
void pack_sums(const PackedSums* sums, std::int64_t num, SplatSums<float>* out, cudaStream_t stream);

}  // namespace gs
