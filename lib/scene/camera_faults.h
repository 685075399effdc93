// SPDX-License-Identifier: Apache-2.0
// Camera poses that cannot be right.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "lib/scene/source_scene.h"

namespace gs {

/// Returns the median distance between where an image shows its points and where its pose does, as a share of the
/// image's larger side, at most 1; nothing if fewer than ten points are known.
std::optional<double> track_error(const SourceView& view);

/// Returns for each camera whether it stands far outside of the others: at more than six times the median distance from
/// their middle. None does if there are fewer than five cameras, or if more than a tenth would: those are a second
/// place.
std::vector<bool> far_cameras(const std::vector<Eigen::Vector3d>& centers);

/// Leaves out the training views whose poses cannot be right: those that contradict the points which the images see,
/// and those of far cameras that see no point, if the dataset does not say what they see. Notes name them, test views
/// with such poses, which are kept, and far cameras that remain.
void leave_out_wrong_poses(const std::vector<SourceView>& views, const SourcePoints& points,
                           std::vector<ViewRole>& roles, std::vector<std::string>& notes);

}  // namespace gs
