// SPDX-License-Identifier: Apache-2.0
// The picture from the blended Gaussians, as resolve.frag.glsl. In front of this stands the struct Data, behind it resolve.glsl, translated.

@group(0) @binding(0) var<storage, read> data: Data;
@group(0) @binding(1) var blended: texture_2d<f32>;

/// One triangle over the whole target.
@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f { return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i & 2u) * 2.0 - 1.0, 0.0, 1.0); }

@fragment fn pixel(@builtin(position) position: vec4f) -> @location(0) vec4f { return vec4f(resolved_(textureLoad(blended, vec2i(position.xy), 0)), 1.0); }
