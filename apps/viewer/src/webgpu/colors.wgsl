// SPDX-License-Identifier: Apache-2.0
// The colours of the Gaussians in the view, in their order. In front of this stand the struct Data with what the file and the view
// say, counts.wgsl, and kEightBits; behind it gaussian.glsl, colors.glsl and the model's own GLSL, translated.

@group(0) @binding(0) var<storage, read> data: Data;
@group(0) @binding(1) var<storage, read> geometry: array<vec4u>;
@group(0) @binding(2) var<storage, read> quads: array<vec4u>;
@group(0) @binding(3) var<storage, read> pairs: array<vec2u>;
@group(0) @binding(4) var<storage, read> counts: Counts;
@group(0) @binding(5) var<storage, read> order: array<u32>;
@group(0) @binding(6) var<storage, read_write> colors: array<vec2u>;

var<private> row: i32; // of the payload
fn payload(k: i32) -> vec4u { return quads[k * data.layer_texels + row]; }
fn payload_pair() -> vec2u { return pairs[row]; }

@compute @workgroup_size(256) fn color_visible(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= counts.visible) { return; }
    let i = order[id.x];
    let color = vec4f(shown_color_(i32(i), geometry[i]), 1.0);
    // As a texture with eight bits or with half-precision numbers would hold it.
    if (kEightBits) { colors[id.x] = vec2u(pack4x8unorm(color), 0u); }
    else { colors[id.x] = vec2u(pack2x16float(color.xy), pack2x16float(color.zw)); }
}
