// SPDX-License-Identifier: Apache-2.0
// One corner of the quad around one Gaussian: projection as in kernels/preprocess/gaussian_device.h, with its constants. In front of
// this stand gaussian.glsl and the data of the view.

const float kDilation = GS_DILATION, kMinDeterminant = 1e-6, kMinAlpha = 1.0 / 255.0, kFrustumMargin = 0.15, kFar = 10000.0;

vec3 decode_scale(uvec4 g) {
    vec3 code = vec3(g.w & 255u, (g.w >> 8) & 255u, (g.w >> 16) & 255u);
    return mix(exp(-12.0 + (code - 1.0) * (21.0 / 254.0)), vec3(0), equal(code, vec3(0)));
}

// Octahedral axis and an angle between 0 and pi.
mat3 decode_rotation(uvec4 g) {
    vec2 p = vec2((g.z >> 16) & 255u, g.z >> 24) / 255.0 * 2.0 - 1.0;
    float half_angle = float(g.w >> 24) / 255.0 * (3.14159265358979 / 2.0);
    vec3 axis = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    if (axis.z < 0.0) axis.xy = (1.0 - abs(p.yx)) * vec2(p.x < 0.0 ? -1.0 : 1.0, p.y < 0.0 ? -1.0 : 1.0);
    vec3 v = normalize(axis) * sin(half_angle);
    float w = cos(half_angle);
    return mat3(1.0 - 2.0 * (v.y * v.y + v.z * v.z), 2.0 * (v.x * v.y + w * v.z), 2.0 * (v.x * v.z - w * v.y),
                2.0 * (v.x * v.y - w * v.z), 1.0 - 2.0 * (v.x * v.x + v.z * v.z), 2.0 * (v.y * v.z + w * v.x),
                2.0 * (v.x * v.z + w * v.y), 2.0 * (v.y * v.z - w * v.x), 1.0 - 2.0 * (v.x * v.x + v.y * v.y));
}

// Where the corner (each of its numbers -1 or 1) of a Gaussian with the geometry g lies on the screen. `shown` is the Gaussian's colour and
// greatest alpha, `offset` the corner in standard deviations.
vec4 place_corner(uvec4 g, vec3 color, vec2 corner, out vec4 shown, out vec2 offset) {
    const vec4 nowhere = vec4(2.0, 2.0, 0.0, 1.0); // all four corners there: nothing is drawn
    shown = vec4(color, float(g.x >> 24) / 255.0);
    offset = vec2(0);
    vec3 cam = rotation * decode_mean(g) + translation;
    if (!(cam.z >= near_plane && cam.z <= kFar) || shown.a < kMinAlpha) return nowhere;

    vec2 focal = intrinsics.xy, center = intrinsics.zw, uv = cam.xy / cam.z;
    vec2 clipped = clamp(uv, (-kFrustumMargin * size - center) / focal, ((1.0 + kFrustumMargin) * size - center) / focal);
    vec3 s = splat_size * decode_scale(g);
    mat3 axes = rotation * decode_rotation(g); // columns: the principal axes, seen from the camera
    vec3 du = focal.x / cam.z * vec3(axes[0].x - clipped.x * axes[0].z, axes[1].x - clipped.x * axes[1].z, axes[2].x - clipped.x * axes[2].z) * s;
    vec3 dv = focal.y / cam.z * vec3(axes[0].y - clipped.y * axes[0].z, axes[1].y - clipped.y * axes[1].z, axes[2].y - clipped.y * axes[2].z) * s;
    vec3 cov = vec3(dot(du, du), dot(du, dv), dot(dv, dv)); // xx, xy, yy
    cov.xz += kDilation;
#if GS_ANTIALIASED
    vec3 across = cross(du, dv); // a sum of squares, which does not cancel for needles
    float before = dot(across, across), determinant = before + kDilation * (cov.x + cov.z - kDilation);
#else
    float determinant = cov.x * cov.z - cov.y * cov.y;
#endif
    if (!(determinant >= kMinDeterminant && cov.x <= 1e12 && cov.z <= 1e12)) return nowhere;
#if GS_ANTIALIASED
    if (splat_size > 0.0) shown.a *= sqrt(max(before / determinant, 0.0)); // points would all vanish
    if (shown.a < kMinAlpha) return nowhere;
#endif

    // The square that circumscribes the circle where alpha falls to kMinAlpha, mapped by the covariance's Cholesky factor.
    float radius = sqrt(2.0 * log(max(shown.a / kMinAlpha, 1.0)));
    float l11 = sqrt(cov.x), l21 = cov.y / l11, l22 = sqrt(max(determinant / cov.x, 0.0));
    offset = corner * radius;
    vec2 pixel = focal * uv + center + vec2(l11 * offset.x, l21 * offset.x + l22 * offset.y);
    return vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
}
