// SPDX-License-Identifier: Apache-2.0
// The colour that every Gaussian shows to one camera: a pixel for each. In front of this stand gaussian.glsl and the GS_ constants of the
// file, behind it colors.glsl and the model's own residual().

uniform highp usampler2D geometry;
uniform highp usampler2DArray payload_quads;
uniform highp usampler2D payload_pairs;
#if GS_WEIGHTS > 0
layout(std140) uniform Weights { vec4 weights[GS_WEIGHTS]; };
#endif
#if GS_FLOATS > 0
uniform float header_floats[GS_FLOATS];
#endif
uniform float base_scale, base_offset;
uniform vec3 camera_position, camera_forward;
uniform float center_depth;
uniform int count, num_residuals, mode;

out vec4 result;

int row; // of the payload
uvec4 payload(int k) { return texelFetch(payload_quads, ivec3(texel_of(row), k), 0); }
uvec2 payload_pair() { return texelFetch(payload_pairs, texel_of(row), 0).xy; }

vec3 shown_color(int i, uvec4 g);

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    int i = texel.y * 2048 + texel.x;
    result = vec4(0);
    if (i >= count) return;
    result = vec4(shown_color(i, texelFetch(geometry, texel, 0)), 1.0);
}
