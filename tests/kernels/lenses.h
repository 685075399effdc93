// SPDX-License-Identifier: Apache-2.0
// One lens of each model for the kernel tests, with the range in which it is one to one.
#pragma once

#include <cmath>
#include <vector>

#include "tests/kernels/random_scene.h"

namespace gs::test {

struct TestLens {
    const char* name;
    Lens<double> lens;
};

/// Returns a lens that is used up to `max_angle` radians from its axis.
inline TestLens test_lens(const char* name, CameraModel model, double max_angle, std::vector<double> distortion) {
    TestLens out{name, {.model = model, .max_angle = max_angle}};
    std::copy(distortion.begin(), distortion.end(), out.lens.distortion);
    const auto radius = [&](double angle) {
        const Vec2<double> p = distort_direction(out.lens, Vec3<double>{std::sin(angle), 0, std::cos(angle)});
        return std::hypot(p.x, p.y);
    };
    out.lens.slope = (radius(max_angle) - radius(max_angle - 1e-6)) / 1e-6;
    out.lens.sin_max = std::sin(max_angle), out.lens.cos_max = std::cos(max_angle);
    out.lens.cos_drawn = std::cos(max_angle + 0.3);
    return out;
}

inline const std::vector<TestLens>& test_lenses() {
    using M = CameraModel;
    static const std::vector<TestLens> lenses = {
        test_lens("SIMPLE_FISHEYE, 200 degrees", M::kSimpleFisheye, 1.745, {}),
        test_lens("OPENCV_FISHEYE", M::kOpenCVFisheye, 1.6, {-0.03, 0.004, -0.001, 0.0002}),
        test_lens("THIN_PRISM_FISHEYE", M::kThinPrismFisheye, 1.2, {-0.04, 0.01, 0.006, -0.008, 0, 0, 0.012, -0.01}),
        test_lens("RAD_TAN_THIN_PRISM_FISHEYE", M::kRadTanThinPrismFisheye, 1.1,
                  {-0.02, 0.01, 0, 0, 0, 0, 0.004, -0.003, 0.002, 0.001, -0.003, 0.001}),
        test_lens("SIMPLE_RADIAL", M::kSimpleRadial, 0.8, {-0.2}),
        test_lens("OPENCV", M::kOpenCV, 0.7, {0.1, -0.05, 0.003, -0.002}),
        test_lens("FULL_OPENCV", M::kFullOpenCV, 0.7, {0.2, 0.1, 0.002, -0.001, 0.02, 0.1, 0.03, 0.01}),
        test_lens("FOV", M::kFov, 1.4, {0.9, 2 * std::tan(0.45)}),
        test_lens("DIVISION", M::kDivision, 1.3, {-0.3}),
        test_lens("EUCM", M::kEucm, 1.6, {0.62, 1.1}),
    };
    return lenses;
}

inline const TestLens& equirectangular_lens() {
    static const TestLens lens{"EQUIRECTANGULAR", {.model = CameraModel::kEquirectangular}};
    return lens;
}

/// Returns the lens with Gaussians drawn as by pinholes.
inline TestLens drawn_as_pinholes(TestLens test) {
    test.lens.as_pinholes = true;
    return test;
}

/// Returns a camera behind the lens whose rim lies at the ends of the image's width.
inline CameraParams<double> lens_camera(const TestLens& test, int width, int height) {
    CameraParams<double> camera = test_camera(width, height);
    camera.lens = test.lens;
    if (camera.lens.wraps()) {
        camera.fx = width, camera.fy = height, camera.cx = camera.cy = 0;
        return camera;
    }
    const Vec2<double> rim = distort_direction(test.lens, Vec3<double>{test.lens.sin_max, 0, test.lens.cos_max});
    camera.fx = camera.fy = 0.5 * width / rim.x;
    return camera;
}

}  // namespace gs::test
