// SPDX-License-Identifier: Apache-2.0
// Toy in the viewer: the matrix by rows, as half-precision numbers.
vec3 residual(vec3 d) {
    float m[GS_HALVES] = payload_halves();
    return vec3(dot(vec3(m[0], m[1], m[2]), d), dot(vec3(m[3], m[4], m[5]), d), dot(vec3(m[6], m[7], m[8]), d));
}
