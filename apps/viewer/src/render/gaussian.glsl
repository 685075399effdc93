// SPDX-License-Identifier: Apache-2.0
// Where a Gaussian's data lie in textures, and where it lies in space by its packed geometry (docs/formats.md).

ivec2 texel_of(int index) { return ivec2(index & 2047, index >> 11); }

vec3 decode_mean(uvec4 g) { return vec3(unpackHalf2x16(g.y), unpackHalf2x16(g.z).x); }
