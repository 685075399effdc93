// SPDX-License-Identifier: Apache-2.0
// One fragment of a Gaussian, premultiplied.
flat in vec4 shown;
in vec2 offset;
out vec4 result;

void main() {
    float alpha = shown.a * exp(-0.5 * dot(offset, offset));
    if (alpha < 1.0 / 255.0) discard;
    result = vec4(shown.rgb * alpha, alpha);
}
