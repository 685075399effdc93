// SPDX-License-Identifier: Apache-2.0
// Where the Gaussians of a model are.

import { halfToFloat } from '../format/half';
import type { Vector } from '../format/vector';

export interface Extent {
  center: Vector;
  radius: number;
}

/** Trained scenes have stray Gaussians far outside; a sphere around those would show the scene as a dot. */
const SHARE = 0.99;
/** More Gaussians than this do not change the sphere that one sees. */
const MOST_SAMPLES = 100_000;

/** Keeps the centres of some Gaussians, evenly chosen. */
export class CenterSample {
  private readonly step: number;
  private readonly centers: Vector[] = [];
  private seen = 0;

  constructor(private readonly count: number) {
    this.step = Math.max(1, Math.ceil(count / MOST_SAMPLES));
  }

  /** Takes the next texels of packed geometry. */
  add(texels: Uint32Array): void {
    const end = Math.min(this.seen + texels.length / 4, this.count);
    for (let i = this.centers.length * this.step; i < end; i += this.step) {
      const xy = texels[4 * (i - this.seen) + 1], z = texels[4 * (i - this.seen) + 2];
      this.centers.push([halfToFloat(xy & 0xffff), halfToFloat(xy >>> 16), halfToFloat(z & 0xffff)]);
    }
    this.seen += texels.length / 4;
  }

  /** The sphere around the median centre that holds 99 of 100 Gaussians. */
  extent(): Extent {
    const { centers } = this, n = centers.length;
    if (n === 0) return { center: [0, 0, 0], radius: 1 };
    const center = [0, 1, 2].map((axis) => Float32Array.from(centers, (c) => c[axis]).sort()[n >> 1]) as Vector;
    const distances = Float32Array.from(centers, (c) => Math.hypot(c[0] - center[0], c[1] - center[1], c[2] - center[2])).sort();
    return { center, radius: distances[Math.min(n - 1, Math.ceil(SHARE * n))] };
  }
}
