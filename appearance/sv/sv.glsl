// SPDX-License-Identifier: Apache-2.0
// SV in the viewer: GS_SITES sites of 7 half-precision numbers each: site, temperature, colour (README.md has the equation).

vec3 residual(vec3 d) {
    float p[GS_HALVES] = payload_halves();
    float largest = -1e30, sum = 0.0;
    vec3 color = vec3(0);
    for (int i = 0; i < GS_SITES; ++i) {
        vec3 site = normalize(vec3(p[7 * i], p[7 * i + 1], p[7 * i + 2])); // rounded to half precision it has not quite unit length
        float logit = -p[7 * i + 3] * distance(site, d);
        float factor = exp(-abs(logit - largest));
        vec3 c = vec3(p[7 * i + 4], p[7 * i + 5], p[7 * i + 6]);
        bool likelier = logit > largest;
        color = likelier ? color * factor + c : color + c * factor;
        sum = likelier ? sum * factor + 1.0 : sum + factor;
        largest = max(largest, logit);
    }
    return color / sum;
}
