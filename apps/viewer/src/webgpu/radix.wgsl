// SPDX-License-Identifier: Apache-2.0
// One pass of a stable radix sort by 8 bits of the keys, from `shift` on: how often each digit is in each block of 4096, where each digit of
// each block begins, and all keys there with their indices. In front of this stand scan.wgsl and counts.wgsl.

override shift: u32;

@group(0) @binding(0) var<storage, read> counts: Counts;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> indices: array<u32>;
@group(0) @binding(3) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_indices: array<u32>;
@group(0) @binding(5) var<storage, read_write> places: array<u32>; // by digit and block
@group(0) @binding(6) var<storage, read_write> digits: array<u32>; // how often each digit is anywhere

const kBlock = 4096u;

var<workgroup> tally: array<atomic<u32>, 256>;
/// Of each digit, the threads of a workgroup that have it: a bit each.
var<workgroup> holders: array<atomic<u32>, 2048>;
var<workgroup> begins: array<u32, 256>;

fn digit_of(i: u32) -> u32 { return (keys[i] >> shift) & 255u; }

@compute @workgroup_size(256) fn count_digits(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3u) {
    atomicStore(&tally[thread], 0u);
    workgroupBarrier();
    let end = min(counts.visible, (group.x + 1u) * kBlock);
    for (var i = group.x * kBlock + thread; i < end; i += 256u) { atomicAdd(&tally[digit_of(i)], 1u); }
    workgroupBarrier();
    places[thread * counts.sort_groups.x + group.x] = atomicLoad(&tally[thread]);
}

/// A workgroup for each digit.
@compute @workgroup_size(256) fn place_digits(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3u) {
    let num_blocks = counts.sort_groups.x;
    var before = 0u;
    for (var first = 0u; first < num_blocks; first += 256u) {
        let block = first + thread;
        let at = group.x * num_blocks + block;
        var size = 0u;
        if (block < num_blocks) { size = places[at]; }
        let end = before + scanned(thread, size);
        if (block < num_blocks) { places[at] = end - size; }
        before += sums[255];
    }
    if (thread == 0u) { digits[group.x] = before; }
}

@compute @workgroup_size(256) fn move_keys(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3u) {
    let size = digits[thread];
    begins[thread] = scanned(thread, size) - size + places[thread * counts.sort_groups.x + group.x];
    let word = thread / 32u;
    let bit = 1u << (thread % 32u);
    for (var first = 0u; first < kBlock; first += 256u) {
        for (var k = 0u; k < 8u; k++) { atomicStore(&holders[8u * thread + k], 0u); }
        workgroupBarrier();
        let i = group.x * kBlock + first + thread;
        let is_there = i < counts.visible;
        var digit = 0u;
        if (is_there) {
            digit = digit_of(i);
            atomicOr(&holders[8u * digit + word], bit);
        }
        workgroupBarrier();
        if (is_there) {
            var to = begins[digit] + countOneBits(atomicLoad(&holders[8u * digit + word]) & (bit - 1u));
            for (var k = 0u; k < word; k++) { to += countOneBits(atomicLoad(&holders[8u * digit + k])); }
            sorted_keys[to] = keys[i];
            sorted_indices[to] = indices[i];
        }
        workgroupBarrier();
        for (var k = 0u; k < 8u; k++) { begins[thread] += countOneBits(atomicLoad(&holders[8u * thread + k])); }
    }
}
