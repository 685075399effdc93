// SPDX-License-Identifier: Apache-2.0
// One fragment of a Gaussian, premultiplied; all 0 where nothing of it is seen.
vec4 fragment_of(vec4 shown, vec2 offset) {
    float alpha = shown.a * exp(-0.5 * dot(offset, offset));
    return alpha < 1.0 / 255.0 ? vec4(0) : vec4(shown.rgb * alpha, alpha);
}
