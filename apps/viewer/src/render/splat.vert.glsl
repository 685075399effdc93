// SPDX-License-Identifier: Apache-2.0
// The corners of all Gaussians' quads. In front of this stands gaussian.glsl, behind it splat.glsl.

uniform highp usampler2D geometry;
uniform highp sampler2D colors;
uniform mat3 rotation; // of cam_from_world, OpenCV axes
uniform vec3 translation;
uniform vec4 intrinsics; // fx, fy, cx, cy in pixels
uniform vec2 size;
uniform float splat_size, near_plane; // a factor of all scales, 0 for points; and nothing nearer is drawn

in vec3 position; // x, y: the corner
in uint order;

flat out vec4 shown;
out vec2 offset;

vec4 place_corner(uvec4 g, vec3 color, vec2 corner, out vec4 shown, out vec2 offset);

void main() {
    ivec2 texel = texel_of(int(order));
    gl_Position = place_corner(texelFetch(geometry, texel, 0), texelFetch(colors, texel, 0).rgb, position.xy, shown, offset);
}
