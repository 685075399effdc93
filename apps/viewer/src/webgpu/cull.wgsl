// SPDX-License-Identifier: Apache-2.0
// Which Gaussians the view may show, in the order of the file, with the keys that they are sorted by. In front of this stand scan.wgsl,
// counts.wgsl, gaussian.glsl, translated, and the struct View.

@group(0) @binding(0) var<storage, read> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4u>;
@group(0) @binding(2) var<storage, read_write> blocks: array<u32>; // of each block how many are in the view, then where those begin
@group(0) @binding(3) var<storage, read_write> counts: Counts;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> indices: array<u32>;

const kBlock = 4096u;

/// The bits of the depth of Gaussian i, 0 where the view does not show it: the bounds are those of DepthSorter (src/sort/sort.ts).
fn depth_bits(i: u32) -> u32 {
    if (i >= view.count) { return 0u; }
    let g = geometry[i];
    if ((g.x >> 24u) == 0u) { return 0u; } // nothing of it is seen, or it has not arrived
    let offset = decode_mean_(g) - view.position;
    let depth = dot(view.forward, offset);
    if (!(depth >= view.near_plane && depth <= view.far_plane)) { return 0u; }
    let code = f32(max(max(g.w & 255u, (g.w >> 8u) & 255u), (g.w >> 16u) & 255u));
    let radius = select(view.deviations * exp(-12.0 + (code - 1.0) * (21.0 / 254.0)), 0.0, code == 0.0);
    let at = vec2f(dot(view.right, offset), dot(view.down, offset));
    let reach = view.reach * radius;
    if (any(at < view.low * depth - reach) || any(at > view.high * depth + reach)) { return 0u; }
    return bitcast<u32>(depth);
}

@compute @workgroup_size(256) fn count_visible(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3u) {
    var mine = 0u;
    for (var i = thread; i < kBlock; i += 256u) { mine += select(0u, 1u, depth_bits(group.x * kBlock + i) != 0u); }
    let sum = scanned(thread, mine);
    if (thread == 255u) { blocks[group.x] = sum; }
}

@compute @workgroup_size(256) fn place_blocks(@builtin(local_invocation_index) thread: u32) {
    let num_blocks = (view.count + kBlock - 1u) / kBlock;
    var before = 0u;
    for (var first = 0u; first < num_blocks; first += 256u) {
        let block = first + thread;
        var size = 0u;
        if (block < num_blocks) { size = blocks[block]; }
        let end = before + scanned(thread, size);
        if (block < num_blocks) { blocks[block] = end - size; }
        before += sums[255];
    }
    if (thread == 0u) {
        counts = Counts(4u, before, 0u, 0u, vec3u((before + kBlock - 1u) / kBlock, 1u, 1u), before, vec3u((before + 255u) / 256u, 1u, 1u), 0u);
    }
}

@compute @workgroup_size(256) fn write_visible(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3u) {
    var begin = blocks[group.x];
    for (var first = 0u; first < kBlock; first += 256u) {
        let i = group.x * kBlock + first + thread;
        let bits = depth_bits(i);
        let is_seen = select(0u, 1u, bits != 0u);
        let at = begin + scanned(thread, is_seen) - is_seen;
        if (bits != 0u) {
            keys[at] = (bitcast<u32>(view.far_plane) - bits) >> 3u; // the farthest first: 24 bits, as no depth is below 0.2
            indices[at] = i;
        }
        begin += sums[255];
    }
}
