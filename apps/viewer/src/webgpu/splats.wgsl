// SPDX-License-Identifier: Apache-2.0
// A quad for every Gaussian in the view. In front of this stand the struct View and kEightBits, behind it gaussian.glsl, splat.glsl and
// fragment.glsl, translated.

@group(0) @binding(0) var<storage, read> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4u>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> colors: array<vec2u>;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) shown: vec4f,
    @location(1) offset: vec2f,
}

@vertex fn corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let packed = colors[instance];
    var color = vec3f(unpack2x16float(packed.x), unpack2x16float(packed.y).x);
    if (kEightBits) { color = unpack4x8unorm(packed.x).rgb; }
    var shown: vec4f;
    var offset: vec2f;
    let position = place_corner_(geometry[order[instance]], color, vec2f(2.0 * f32(vertex & 1u) - 1.0, f32(vertex & 2u) - 1.0), &shown, &offset);
    return Corner(position, shown, offset);
}

@fragment fn blend(corner: Corner) -> @location(0) vec4f {
    let result = fragment_of_(corner.shown, corner.offset);
    if (result.a == 0.0) { discard; }
    return result;
}
