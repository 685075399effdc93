// SPDX-License-Identifier: Apache-2.0
// Gaussians by depth, farthest first.

import type { Vector } from '../format/vector';

/** Nearer Gaussians are not drawn; as in the rasterizer. */
export const NEAR_PLANE = 0.2;

const DIGIT_BITS = 16;
const BUCKETS = 1 << DIGIT_BITS;

/**
 * Sorts by the bits of the depth as a single-precision number, which for positive numbers rise with it: two counting sorts of 16
 * bits each. The order is exact at any scale, so that a few Gaussians far away cost no resolution near by.
 */
export class DepthSorter {
  private readonly keys: Uint32Array;
  private readonly indices: Uint32Array;
  private readonly counts = new Uint32Array(BUCKETS);
  private readonly depth = new Float32Array(1);
  private readonly depthBits = new Uint32Array(this.depth.buffer);

  /** `centers`: x, y, z of every Gaussian. */
  constructor(private readonly centers: Float32Array) {
    this.keys = new Uint32Array(centers.length / 3);
    this.indices = new Uint32Array(centers.length / 3);
  }

  /** Writes those in front of the near plane, farthest first, to the beginning of `order`, and returns how many. Equally far ones keep their order. */
  sort(position: Vector, forward: Vector, order: Uint32Array): number {
    const { centers, keys, indices, depth, depthBits } = this;
    const [fx, fy, fz] = forward;
    const offset = -(fx * position[0] + fy * position[1] + fz * position[2]);
    let visible = 0;
    for (let i = 0, n = keys.length; i < n; ++i) {
      depth[0] = fx * centers[3 * i] + fy * centers[3 * i + 1] + fz * centers[3 * i + 2] + offset;
      if (!(depth[0] >= NEAR_PLANE)) continue;
      keys[i] = ~depthBits[0];
      indices[visible++] = i;
    }
    this.pass(indices, order, visible, 0);
    this.pass(order, indices, visible, DIGIT_BITS);
    order.set(indices.subarray(0, visible));
    return visible;
  }

  /** One stable counting sort by the 16 bits of the key from `shift` on. */
  private pass(from: Uint32Array, to: Uint32Array, n: number, shift: number): void {
    const { keys, counts } = this;
    counts.fill(0);
    for (let i = 0; i < n; ++i) ++counts[(keys[from[i]] >>> shift) & (BUCKETS - 1)];
    let begin = 0;
    for (let b = 0; b < BUCKETS; ++b) {
      const size = counts[b];
      counts[b] = begin;
      begin += size;
    }
    for (let i = 0; i < n; ++i) to[counts[(keys[from[i]] >>> shift) & (BUCKETS - 1)]++] = from[i];
  }
}
