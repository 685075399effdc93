// SPDX-License-Identifier: Apache-2.0
// NASG and NASGabor in the viewer: GS_LOBES lobes of half-precision numbers each: frame x and z, 2 lambda, a, with a carrier k,
// N, amplitude (README.md has the equations; nasg.h the same in single precision).

#if GS_CARRIER
const int per_lobe = 13;
#else
const int per_lobe = 12;
#endif

// GLSL has neither of these, and near 0 the plain forms cancel. Each series is exact to single precision where it is used.
float log1p(float x) {
    if (abs(x) > 0.25) return log(1.0 + x);
    float r = x / (2.0 + x), r2 = r * r; // ln(1+x) = 2 artanh r
    return 2.0 * r * (1.0 + r2 * (1.0 / 3.0 + r2 * (0.2 + r2 / 7.0)));
}
float expm1(float x) {
    if (abs(x) > 0.25) return exp(x) - 1.0;
    return x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x / 720.0)))));
}

// Density in the lobe's frame. At the axis it is its limit n.
float lobe_density(vec3 v, float t, float a, float n) {
    float s2 = max(v.x * v.x + v.y * v.y, 1e-14);
    float log_k = v.z >= 0.0 ? log1p(-s2 / (2.0 * (1.0 + v.z))) : log(s2 / (2.0 * (1.0 - v.z)));
    float kappa = 5e-6 + a * v.x * v.x / s2;
    return n * exp(kappa * log_k + t * expm1((1.0 + kappa) * log_k));
}

vec3 residual(vec3 d) {
    float p[GS_HALVES] = payload_halves();
    vec3 sum = vec3(0);
    for (int lobe = 0; lobe < GS_LOBES; ++lobe) {
        int i = lobe * per_lobe;
        // Rounded to half precision, the frame is no longer orthonormal, and directions within 1.8 degrees of the axis would be beyond it.
        vec3 z = normalize(vec3(p[i + 3], p[i + 4], p[i + 5])), x = vec3(p[i], p[i + 1], p[i + 2]);
        x = normalize(x - z * dot(x, z));
        vec3 v = vec3(dot(d, x), dot(d, cross(z, x)), dot(d, z));
#if GS_CARRIER
        float carrier = cos(0.5 * p[i + 8] * v.x);
        float value = lobe_density(v, p[i + 6], p[i + 7], p[i + 9]) * carrier * carrier;
#else
        float value = lobe_density(v, p[i + 6], p[i + 7], p[i + 8]);
#endif
        int rgb = i + per_lobe - 3;
        sum += value * vec3(p[rgb], p[rgb + 1], p[rgb + 2]);
    }
    return sum;
}
