// SPDX-License-Identifier: Apache-2.0
// SH in the viewer, from the coefficients as .ngsplat packs them: 7, 8 and 6 bits in degrees 1, 2 and 3 (README.md has the basis),
// times what the header says of each degree, by its largest code.

// Field `index` of `bits` bits, two's complement, of words that are one number from the lowest bit on.
float sh_field(uint words[4], int index, int bits) {
    int at = index * bits, word = at >> 5, shift = at & 31;
    uint code = words[word] >> shift;
    if (shift + bits > 32) code |= words[word + 1] << (32 - shift);
    return float(int(code << (32 - bits)) >> (32 - bits));
}

vec3 sh_coefficient(uint words[4], int index, int bits) {
    return vec3(sh_field(words, 3 * index, bits), sh_field(words, 3 * index + 1, bits), sh_field(words, 3 * index + 2, bits));
}

vec3 residual(vec3 d) {
    vec3 sum = vec3(0);
    float x = d.x, y = d.y, z = d.z;
#if GS_DEGREE >= 1
    uvec2 pair = payload_pair();
    uint w1[4] = uint[4](pair.x, pair.y, 0u, 0u);
    float y1[3] = float[3](-y, z, -x);
    vec3 band1 = vec3(0);
    for (int i = 0; i < 3; ++i) band1 += y1[i] * sh_coefficient(w1, i, 7);
    sum += (header_floats[0] / 63.0 * 0.4886025119029199) * band1;
#endif
#if GS_DEGREE >= 2
    uvec4 t2 = payload(0);
    uint w2[4] = uint[4](t2.x, t2.y, t2.z, t2.w);
    float y2[5] = float[5](1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.9461746957575601 * z * z - 0.31539156525252005,
                           -1.0925484305920792 * x * z, 0.5462742152960396 * (x * x - y * y));
    vec3 band2 = vec3(0);
    for (int i = 0; i < 5; ++i) band2 += y2[i] * sh_coefficient(w2, i, 8);
    sum += header_floats[1] / 127.0 * band2;
#endif
#if GS_DEGREE >= 3
    uvec4 t3 = payload(1);
    uint w3[4] = uint[4](t3.x, t3.y, t3.z, t3.w);
    float y3[7] = float[7](0.5900435899266435 * y * (y * y - 3.0 * x * x), 2.890611442640554 * x * y * z, 0.4570457994644658 * y * (1.0 - 5.0 * z * z),
                           0.3731763325901154 * z * (5.0 * z * z - 3.0), 0.4570457994644658 * x * (1.0 - 5.0 * z * z),
                           1.445305721320277 * z * (x * x - y * y), 0.5900435899266435 * x * (3.0 * y * y - x * x));
    vec3 band3 = vec3(0);
    for (int i = 0; i < 7; ++i) band3 += y3[i] * sh_coefficient(w3, i, 6);
    sum += header_floats[2] / 31.0 * band3;
#endif
    return residual_activation(sum);
}
