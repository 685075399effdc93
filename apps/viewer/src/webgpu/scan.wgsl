// SPDX-License-Identifier: Apache-2.0
// Sums over the 256 threads of a workgroup.

var<workgroup> sums: array<u32, 256>;

/// The sum of the values of the threads up to and including this one. All threads call it; the sum of all is sums[255] from then on.
fn scanned(thread: u32, value: u32) -> u32 {
    workgroupBarrier();
    sums[thread] = value;
    workgroupBarrier();
    for (var distance = 1u; distance < 256u; distance *= 2u) {
        var before = 0u;
        if (thread >= distance) { before = sums[thread - distance]; }
        workgroupBarrier();
        sums[thread] += before;
        workgroupBarrier();
    }
    return sums[thread];
}
