// SPDX-License-Identifier: Apache-2.0
// Neural in the viewer: GS_HIDDEN_LAYERS layers of GS_NEURONS, whose weights come four at a time (README.md has the network).
// weights[base + j out + o] holds the weights from inputs 4j..4j+3 to output o. GS_FOLDED: what does not depend on the direction
// is already multiplied by the first layer, and a Gaussian's numbers are its sums; otherwise they are the encoded features.

const int quads = GS_NEURONS / 4;

#if GS_BANDS >= 16
// The associated Legendre polynomial P_l^m of z without its factor (1 - z^2)^(m/2), with the sign (-1)^m, times the factor that makes the
// spherical harmonic's square integrate to 1.
float normalized_legendre(int l, int m, float z) {
    float before = 0.0, value = 1.0, square = float(2 * l + 1) / 12.566370614359172;
    for (int k = 1; k <= m; ++k) value *= -float(2 * k - 1);
    for (int k = m + 1; k <= l; ++k) {
        float next = (float(2 * k - 1) * z * value - float(k + m - 1) * before) / float(k - m);
        before = value;
        value = next;
    }
    for (int k = l - m + 1; k <= l + m; ++k) square /= float(k);
    return value * sqrt(m == 0 ? square : 2.0 * square);
}
#endif

// The spherical harmonics of degree l, 1 to 6, and the constant, in the order in which they enter; zeros behind.
void network_inputs(vec3 d, float p[GS_HALVES], out vec4 inputs[GS_INPUTS / 4]) {
    float flat_inputs[GS_INPUTS];
    int n = 0;
#if !GS_FOLDED
    for (int i = 0; i < GS_FEATURES; ++i) flat_inputs[n++] = p[i];
#if GS_CONSTANT_INPUT
    flat_inputs[n++] = 0.28209479177387814;
#endif
#endif
    float x = d.x, y = d.y, z = d.z;
#if GS_BANDS / 2 % 2 == 1
    flat_inputs[n++] = -0.4886025119029199 * y;
    flat_inputs[n++] = 0.4886025119029199 * z;
    flat_inputs[n++] = -0.4886025119029199 * x;
#endif
#if GS_BANDS / 4 % 2 == 1
    flat_inputs[n++] = 1.0925484305920792 * x * y;
    flat_inputs[n++] = -1.0925484305920792 * y * z;
    flat_inputs[n++] = 0.9461746957575601 * z * z - 0.31539156525252005;
    flat_inputs[n++] = -1.0925484305920792 * x * z;
    flat_inputs[n++] = 0.5462742152960396 * (x * x - y * y);
#endif
#if GS_BANDS / 8 % 2 == 1
    flat_inputs[n++] = 0.5900435899266435 * y * (y * y - 3.0 * x * x);
    flat_inputs[n++] = 2.890611442640554 * x * y * z;
    flat_inputs[n++] = 0.4570457994644658 * y * (1.0 - 5.0 * z * z);
    flat_inputs[n++] = 0.3731763325901154 * z * (5.0 * z * z - 3.0);
    flat_inputs[n++] = 0.4570457994644658 * x * (1.0 - 5.0 * z * z);
    flat_inputs[n++] = 1.445305721320277 * z * (x * x - y * y);
    flat_inputs[n++] = 0.5900435899266435 * x * (3.0 * y * y - x * x);
#endif
#if GS_BANDS >= 16
    for (int l = 4; l <= 6; ++l) {
        if ((GS_BANDS >> l & 1) == 0) continue;
        vec2 power = vec2(1, 0); // (x + iy)^m
        for (int m = 0; m <= l; ++m) {
            float factor = normalized_legendre(l, m, z);
            flat_inputs[n + l - m] = factor * power.y;
            flat_inputs[n + l + m] = factor * power.x; // last, as of m = 0 this is the one that is not 0
            power = vec2(x * power.x - y * power.y, x * power.y + y * power.x);
        }
        n += 2 * l + 1;
    }
#endif
    for (; n < GS_INPUTS; ++n) flat_inputs[n] = 0.0;
    for (int j = 0; j < GS_INPUTS / 4; ++j) inputs[j] = vec4(flat_inputs[4 * j], flat_inputs[4 * j + 1], flat_inputs[4 * j + 2], flat_inputs[4 * j + 3]);
}

vec4 weights_times(int base, int j, int outputs, int o, vec4 x) {
    int t = base + j * outputs + o;
    return vec4(dot(weights[t], x), dot(weights[t + 1], x), dot(weights[t + 2], x), dot(weights[t + 3], x));
}

vec3 residual(vec3 d) {
    float p[GS_HALVES] = payload_halves();
    vec4 inputs[GS_INPUTS / 4];
    network_inputs(d, p, inputs);
    vec4 hidden[quads], next[quads];
    for (int q = 0; q < quads; ++q) {
#if GS_FOLDED
        vec4 sum = vec4(p[4 * q], p[4 * q + 1], p[4 * q + 2], p[4 * q + 3]);
#else
        vec4 sum = vec4(0);
#endif
        for (int j = 0; j < GS_INPUTS / 4; ++j) sum += weights_times(0, j, GS_NEURONS, 4 * q, inputs[j]);
        hidden[q] = max(sum, 0.0);
    }
    int base = GS_INPUTS / 4 * GS_NEURONS;
    for (int layer = 1; layer < GS_HIDDEN_LAYERS; ++layer) {
        for (int q = 0; q < quads; ++q) {
            next[q] = vec4(0);
            for (int j = 0; j < quads; ++j) next[q] += weights_times(base, j, GS_NEURONS, 4 * q, hidden[j]);
        }
        for (int q = 0; q < quads; ++q) hidden[q] = max(next[q], 0.0);
        base += quads * GS_NEURONS;
    }
    vec3 sum = vec3(0);
    for (int j = 0; j < quads; ++j) sum += vec3(dot(weights[base + 3 * j], hidden[j]), dot(weights[base + 3 * j + 1], hidden[j]), dot(weights[base + 3 * j + 2], hidden[j]));
    return residual_activation(sum);
}
