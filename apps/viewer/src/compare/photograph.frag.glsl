// SPDX-License-Identifier: Apache-2.0
// A photograph where its test view lies in the picture.
uniform highp sampler2D photograph;
uniform vec2 corner; // of the photograph, pixels from the upper left
uniform vec2 extent; // pixels of the picture
uniform float height; // of the picture

out vec4 result;

void main() {
    vec2 at = (vec2(gl_FragCoord.x, height - gl_FragCoord.y) - corner) / extent;
    bool inside = all(greaterThanEqual(at, vec2(0.0))) && all(lessThanEqual(at, vec2(1.0)));
    // The lookup is outside of any branch, for it compares with its neighbours' to choose a size.
    vec3 color = texture(photograph, at).rgb;
    result = vec4(inside ? color : vec3(0.0), 1.0);
}
