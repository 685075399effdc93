// SPDX-License-Identifier: Apache-2.0
// From the blended Gaussians to the picture, with 8 bits. Behind this stands resolve.glsl.
uniform highp sampler2D blended;
uniform ivec2 origin; // of the picture in what it is drawn into
uniform vec3 background;
uniform bool corrected;
uniform float gain;
uniform mat3 mix_colors;
uniform float response[18]; // per channel toe, shoulder, gamma, centre, a, b

out vec4 result;

vec3 resolved(vec4 b);

void main() { result = vec4(resolved(texelFetch(blended, ivec2(gl_FragCoord.xy) - origin, 0)), 1.0); }
