// SPDX-License-Identifier: Apache-2.0
// Where the Gaussians of a model are.

import type { Vector } from '../format/vector';

export interface Extent {
  center: Vector;
  radius: number;
}

/** Trained scenes have stray Gaussians far outside; a sphere around those would show the scene as a dot. */
const SHARE = 0.99;
/** More Gaussians than this do not change the sphere that one sees. */
const MOST_SAMPLES = 100_000;

/** The sphere around the median centre that holds 99 of 100 Gaussians. `centers` has x, y, z of each. */
export function sceneExtent(centers: Float32Array): Extent {
  const count = centers.length / 3, step = Math.max(1, Math.ceil(count / MOST_SAMPLES)), samples = Math.ceil(count / step);
  if (samples === 0) return { center: [0, 0, 0], radius: 1 };
  const values = new Float32Array(samples);
  const center = [0, 1, 2].map((axis) => values.map((_, i) => centers[3 * step * i + axis]).sort()[samples >> 1]) as Vector;
  const distances = values.map((_, i) => Math.hypot(...center.map((c, axis) => centers[3 * step * i + axis] - c))).sort();
  return { center, radius: distances[Math.min(samples - 1, Math.ceil(SHARE * samples))] };
}
