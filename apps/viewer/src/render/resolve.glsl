// SPDX-License-Identifier: Apache-2.0
// From the blended Gaussians of a pixel to its colour: background and photometric correction.

// As isp_curve and isp_respond in kernels/ppisp/ppisp_device.h.
float respond(float value, int c) {
    float toe = response[6 * c], shoulder = response[6 * c + 1], gamma = response[6 * c + 2], centre = response[6 * c + 3];
    float x = clamp(value, 0.0, 1.0), y;
    if (x <= centre) y = x > 0.0 ? response[6 * c + 4] * pow(x / centre, toe) : 0.0;
    else y = 1.0 - response[6 * c + 5] * pow((1.0 - x) / (1.0 - centre), shoulder);
    return y > 0.0 ? pow(y, gamma) : 0.0;
}

// b: colour, premultiplied, and alpha.
vec3 resolved(vec4 b) {
    vec3 color = b.rgb + (1.0 - b.a) * background;
    if (corrected) {
        vec3 exposed = max(color, 0.0) * gain, mapped = mix_colors * exposed;
        float before = exposed.r + exposed.g + exposed.b, after = mapped.r + mapped.g + mapped.b;
        vec3 balanced = mapped * (before / max(after, 1e-5));
        color = vec3(respond(balanced.r, 0), respond(balanced.g, 1), respond(balanced.b, 2));
    }
    return color;
}
