// SPDX-License-Identifier: Apache-2.0
// The colour of a Gaussian towards the camera. In front of this stand the data of the file and of the view: payload(k), the texel k of
// four words of the payload's row, payload_pair(), the one of two words, weights[t], and header_floats[k].

const int kFull = 0, kBase = 1, kResidual = 2, kDepth = 3, kAppearance = 4;

#if GS_HALVES > 0
float[GS_HALVES] payload_halves() {
    float p[GS_HALVES];
    for (int k = 0; k < GS_HALVES / 8; ++k) {
        uvec4 t = payload(k);
        for (int i = 0; i < 4; ++i) {
            vec2 two = unpackHalf2x16(t[i]);
            p[8 * k + 2 * i] = two.x;
            p[8 * k + 2 * i + 1] = two.y;
        }
    }
    return p;
}
#endif

// ln(1 + e^10x)/10 without overflow.
vec3 softplus(vec3 x) { return max(x, 0.0) + log(1.0 + exp(-10.0 * abs(x))) / 10.0; }

vec3 residual_activation(vec3 x) {
#if GS_RESIDUAL_ACTIVATION == 1
    vec3 e = exp(-2.0 * abs(x)); // tanh whose exponential does not overflow
    return sign(x) * (1.0 - e) / (1.0 + e);
#elif GS_RESIDUAL_ACTIVATION == 2
    return softplus(x);
#else
    return x;
#endif
}

// As in appearance/contract.h; half floats end at 65504, and what is infinite would stay so behind an alpha of 0.
const float kLargestColor = 255.0;

// The shift by 1/2 of those activations that have one is part of the stored base colour.
vec3 color_activation(vec3 x) {
#if GS_COLOR_ACTIVATION == 0
    return clamp(x, 0.0, kLargestColor);
#elif GS_COLOR_ACTIVATION == 1
    return min(softplus(x), kLargestColor);
#elif GS_COLOR_ACTIVATION == 2
    return 1.0 / (1.0 + exp(-4.0 * x));
#elif GS_COLOR_ACTIVATION == 3
    return 1.0 - exp(-x);
#elif GS_COLOR_ACTIVATION == 4
    return clamp(x, 0.0, 1.0);
#else
    return x;
#endif
}

vec3 base_color(uvec4 g) {
    vec3 code = vec3(g.x & 255u, (g.x >> 8) & 255u, (g.x >> 16) & 255u);
    vec3 d = code * base_scale + base_offset;
#if GS_EXPONENTIAL_BASE
    d = exp(3.0 * d);
#if GS_COLOR_ACTIVATION != 2 && GS_COLOR_ACTIVATION != 3
    d += 0.5;
#endif
#endif
    return d;
}

vec3 residual(vec3 direction);

// As in apps/gsapp/render/false_colors.cpp: one colour from everywhere, and from little to much that depends on the view.
const vec3 kNoResidual = vec3(0.25), kLeastChange = vec3(0.1, 0.3, 0.9), kMostChange = vec3(1.0, 0.8, 0.1);

// The row of a Gaussian in the payload, -1 for one without. Of each class of importance those with a residual come first.
int payload_row(int i) {
    if (num_residuals == 0) return -1;
    int others = count - num_residuals;
    for (int k = 0; k < GS_CLASSES; ++k) {
        int with = num_residuals * k / GS_CLASSES, next = num_residuals * (k + 1) / GS_CLASSES;
        int begin = with + others * k / GS_CLASSES, end = next + others * (k + 1) / GS_CLASSES;
        if (i < end) return i - begin < next - with ? with + i - begin : -1;
    }
    return -1;
}

// Of Gaussian i with the geometry g.
vec3 shown_color(int i, uvec4 g) {
    vec3 offset = decode_mean(g) - camera_position;
    float depth = dot(offset, camera_forward);
    // White near by, grey at the centre, black far away; the power gives objects around the centre some contrast.
    if (mode == kDepth) return vec3(1.0 / (1.0 + pow(max(depth, 0.0) / center_depth, 3.0)));
    row = payload_row(i);
    bool has_residual = row >= 0;
    vec3 base = base_color(g), base_shown = color_activation(base);
    if (mode == kBase) return base_shown;
    vec3 shown = base_shown;
#if GS_HAS_RESIDUAL
    // Behind the camera nothing is drawn, and on it there is no direction.
    if (has_residual && depth > 0.0) shown = color_activation(base + residual(normalize(offset)));
#endif
    vec3 change = abs(shown - base_shown);
    if (mode == kAppearance) return has_residual ? mix(kLeastChange, kMostChange, min(1.0, 4.0 * (change.r + change.g + change.b) / 3.0)) : kNoResidual;
    return mode == kResidual ? change : shown;
}
