// SPDX-License-Identifier: Apache-2.0
// Solves for the point nearest to all optical axes.
#include "lib/scene/common_target.h"

#include <Eigen/Dense>

namespace gs {

Eigen::Vector3d common_target(const std::vector<View>& views) {
    Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero(), mean = b;
    for (const View& view : views) mean += view.camera.center() / double(views.size());
    for (const View& view : views) {
        const Eigen::Vector3d axis = view.camera.rotation.row(2);
        const Eigen::Matrix3d off_axis =
            Eigen::Matrix3d::Identity() - axis * axis.transpose() + 1e-6 * Eigen::Matrix3d::Identity();
        a += off_axis;
        b += off_axis * (view.camera.center() - mean);  // relative, so that map coordinates lose nothing
    }
    return mean + Eigen::Vector3d(a.ldlt().solve(b));
}

Eigen::Vector3d mean_axis(const std::vector<View>& views) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const View& view : views) mean += view.camera.rotation.row(2).transpose() / double(views.size());
    return mean;
}

}  // namespace gs
