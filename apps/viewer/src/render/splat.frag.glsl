// SPDX-License-Identifier: Apache-2.0
// The fragments of a Gaussian's quad. In front of this stands fragment.glsl.
flat in vec4 shown;
in vec2 offset;
out vec4 result;

void main() {
    result = fragment_of(shown, offset);
    if (result.a == 0.0) discard;
}
