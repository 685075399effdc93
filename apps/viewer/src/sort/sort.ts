// SPDX-License-Identifier: Apache-2.0
// Gaussians that a view may show, by depth, farthest first.

import type { View } from '../camera/view';
import { halfToFloat } from '../format/half';
import { dot } from '../format/vector';

/** Nearer and farther Gaussians are not drawn; as in the rasterizer. */
export const NEAR_PLANE = 0.2;
export const FAR_PLANE = 10000;

/**
 * Share of the picture's size that is sorted beyond each of its edges, so that turning shows no holes before the next
 * order is there.
 */
const MARGIN = 0.15;
/**
 * The vertex shader takes the slope of a Gaussian beside the picture as that of one so far outside (kFrustumMargin).
 */
const SLOPE_MARGIN = 0.15;
/**
 * Standard deviations at which an opaque Gaussian has fallen to an alpha of 1/255, and the pixels that dilation may add
 * to that.
 */
export const MOST_DEVIATIONS = Math.sqrt(2 * Math.log(255));
const DILATION_PIXELS = 2;

const DIGIT_BITS = 11;
const BUCKETS = 1 << DIGIT_BITS;
const KEY_BITS = 2 * DIGIT_BITS;

const halves = Float32Array.from({ length: 1 << 16 }, (_, bits) => halfToFloat(bits));
/** Radius of a Gaussian by the code of its largest standard deviation (docs/formats.md). */
const radii = Float32Array.from({ length: 256 }, (_, code) =>
  code === 0 ? 0 : MOST_DEVIATIONS * Math.exp(-12 + ((code - 1) * 21) / 254),
);

/** x, y, z of every Gaussian, from its packed geometry. */
export function centersOf(geometry: Uint32Array): Float32Array<ArrayBuffer> {
  const centers = new Float32Array((3 * geometry.length) / 4);
  for (let i = 0, k = 0; i < geometry.length; i += 4) {
    centers[k++] = halves[geometry[i + 1] & 0xffff];
    centers[k++] = halves[geometry[i + 1] >>> 16];
    centers[k++] = halves[geometry[i + 2] & 0xffff];
  }
  return centers;
}

/**
 * How a Gaussian at (x, z) of the camera's frame lies in one direction of the picture: it may be seen where low z -
 * reach r <= x <= high z + reach r. `share` of the picture's size counts as part of it beyond its edges.
 */
export function extent(
  focal: number,
  center: number,
  size: number,
  share: number,
): { low: number; high: number; reach: number } {
  const margin = share * size + DILATION_PIXELS;
  const at = (pixel: number) => (pixel - center) / focal;
  const slope = Math.max(Math.abs(at(-SLOPE_MARGIN * size)), Math.abs(at((1 + SLOPE_MARGIN) * size)));
  return { low: at(-margin), high: at(size + margin), reach: Math.hypot(1, slope) };
}

/**
 * Sorts by the bits of the depth as a single-precision number, which for positive numbers rise with it: two counting
 * sorts of 11 bits each. Depths of one view that differ by less than one part in 100,000 may count as equal, which is
 * far less than the file rounds.
 */
export class DepthSorter {
  /** Two words each: x and y as in the file; z, and in the upper half the code of the radius. */
  private readonly geometry: Uint32Array;
  private added = 0;
  private readonly depths: Float32Array;
  private readonly keys: Uint32Array;
  private readonly indices: Uint32Array;
  private readonly digits: Uint16Array;
  private readonly counts = [new Uint32Array(BUCKETS), new Uint32Array(BUCKETS)];

  constructor(private readonly count: number) {
    this.geometry = new Uint32Array(2 * count);
    this.depths = new Float32Array(count);
    this.keys = new Uint32Array(this.depths.buffer);
    this.indices = new Uint32Array(count);
    this.digits = new Uint16Array(count);
  }

  /** Takes the next Gaussians' packed geometry; what is beyond the count is passed over. */
  add(texels: Uint32Array): void {
    const { geometry } = this;
    const n = Math.min(texels.length / 4, this.count - this.added);
    for (let i = 0, k = 2 * this.added; i < 4 * n; i += 4) {
      const scales = texels[i + 3];
      const code = Math.max(scales & 255, (scales >>> 8) & 255, (scales >>> 16) & 255);
      geometry[k++] = texels[i + 1];
      geometry[k++] = (texels[i + 2] & 0xffff) | (code << 16);
    }
    this.added += n;
  }

  /**
   * Writes those that `view` may show, with scales `size` times as large, to the beginning of `order`, farthest first,
   * and returns how many. Equally far ones keep their order.
   */
  sort(view: View, size: number, order: Uint32Array): number {
    const { geometry, depths } = this;
    const { right, down, forward, position } = view;
    const [rx, ry, rz] = right;
    const [dx, dy, dz] = down;
    const [fx, fy, fz] = forward;
    const right0 = -dot(right, position);
    const down0 = -dot(down, position);
    const forward0 = -dot(forward, position);
    const across = extent(view.fx, view.cx, view.width, MARGIN);
    const along = extent(view.fy, view.cy, view.height, MARGIN);
    const left = across.low;
    const rightmost = across.high;
    const reachX = size * across.reach;
    const top = along.low;
    const bottom = along.high;
    const reachY = size * along.reach;
    let visible = 0;
    let nearest = Infinity;
    let farthest = 0;
    for (let i = 0, n = this.added; i < n; ++i) {
      const xy = geometry[2 * i];
      const zr = geometry[2 * i + 1];
      const x = halves[xy & 0xffff];
      const y = halves[xy >>> 16];
      const z = halves[zr & 0xffff];
      const depth = fx * x + fy * y + fz * z + forward0;
      if (!(depth >= NEAR_PLANE && depth <= FAR_PLANE)) continue;
      const radius = radii[zr >>> 16];
      const u = rx * x + ry * y + rz * z + right0;
      if (u < left * depth - reachX * radius || u > rightmost * depth + reachX * radius) continue;
      const v = dx * x + dy * y + dz * z + down0;
      if (v < top * depth - reachY * radius || v > bottom * depth + reachY * radius) continue;
      depths[visible] = depth;
      order[visible++] = i;
      if (depth < nearest) nearest = depth;
      if (depth > farthest) farthest = depth;
    }
    this.sortByDepth(order, visible, nearest, farthest);
    return visible;
  }

  /** `order` holds `n` indices whose depths are in `depths`. */
  private sortByDepth(order: Uint32Array, n: number, nearest: number, farthest: number): void {
    const {
      keys,
      indices,
      digits,
      counts: [low, high],
    } = this;
    const [lowest, highest] = new Uint32Array(Float32Array.of(nearest, farthest).buffer);
    let shift = 0;
    while ((highest - lowest) >>> shift >= 1 << KEY_BITS) ++shift;
    low.fill(0);
    high.fill(0);
    for (let i = 0; i < n; ++i) {
      const key = (highest - keys[i]) >>> shift;
      keys[i] = key;
      ++low[key & (BUCKETS - 1)];
      ++high[key >>> DIGIT_BITS];
    }
    begins(low);
    begins(high);
    for (let i = 0; i < n; ++i) {
      const key = keys[i];
      const at = low[key & (BUCKETS - 1)]++;
      indices[at] = order[i];
      digits[at] = key >>> DIGIT_BITS;
    }
    for (let i = 0; i < n; ++i) order[high[digits[i]]++] = indices[i];
  }
}

/** Where each bucket begins, in place of how many it holds. */
function begins(counts: Uint32Array): void {
  for (let b = 0, begin = 0; b < BUCKETS; ++b) {
    const size = counts[b];
    counts[b] = begin;
    begin += size;
  }
}
