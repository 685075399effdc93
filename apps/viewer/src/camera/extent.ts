// SPDX-License-Identifier: Apache-2.0
// Where the model is: the sphere that "Whole scene" shows and that the camera turns about, and what stands in front of
// it.

import { decodeScale } from '../format/geometry_codes';
import { halfToFloat } from '../format/half';
import { dot, minus, type Vector } from '../format/vector';
import type { View } from './view';

export interface Extent {
  center: Vector;
  radius: number;
}

/** More Gaussians and cameras than these do not change the sphere that one sees. */
const MOST_SAMPLES = 20_000;
const MOST_CAMERAS = 64;
/** A Gaussian reaches so many standard deviations. */
const REACH = 2;
/** Share of the Gaussians that decide where the middle is. */
const MIDDLE = 0.98;
/** Cameras whose mean axis is longer all look one way: their axes meet nowhere in particular. */
const PARALLEL = 0.95;
const ROUNDS = 8;

const distance = (a: Vector, b: Vector): number => Math.hypot(...minus(a, b));
const median = (values: number[]): number => values.sort((a, b) => a - b)[values.length >> 1] ?? 0;
/** At most `most` of a list, evenly chosen. */
const some = <T>(list: readonly T[], most: number): readonly T[] =>
  list.length <= most ? list : Array.from({ length: most }, (_, k) => list[Math.floor((k * list.length) / most)]);

/** Whether a camera has the point in its picture. */
function sees({ position, right, down, forward, fx, fy, cx, cy, width, height }: View, point: Vector): boolean {
  const offset = minus(point, position);
  const z = dot(offset, forward);
  if (!(z > 0)) return false;
  const x = cx + (fx * dot(offset, right)) / z;
  const y = cy + (fy * dot(offset, down)) / z;
  return x >= 0 && x <= width && y >= 0 && y <= height;
}

/** Solves the symmetric a x = b by Cramer's rule. */
function solve(a: number[][], b: Vector): Vector {
  const cross = (p: number[], q: number[]): Vector => [
    p[1] * q[2] - p[2] * q[1],
    p[2] * q[0] - p[0] * q[2],
    p[0] * q[1] - p[1] * q[0],
  ];
  const rows = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])];
  const determinant = dot(a[0] as Vector, rows[0]);
  return [0, 1, 2].map((k) => rows.reduce((sum, row, i) => sum + row[k] * b[i], 0) / determinant) as Vector;
}

/**
 * The point nearest to the optical axes; cameras that look elsewhere count less. Undefined where most cameras do not
 * look at one thing.
 */
export function focusOf(cameras: readonly View[]): Vector | undefined {
  const axis = [0, 1, 2].map((k) => cameras.reduce((sum, { forward }) => sum + forward[k], 0) / cameras.length);
  if (cameras.length < 2 || Math.hypot(...axis) > PARALLEL) return undefined;
  let point: Vector | undefined;
  for (let round = 0; round < ROUNDS; ++round) {
    const a = [
      [0, 0, 0],
      [0, 0, 0],
      [0, 0, 0],
    ];
    const b: Vector = [0, 0, 0];
    for (const { position, forward } of cameras) {
      // By how much the axis misses the point; an angle below a degree is no miss.
      const offset = minus(point ?? position, position);
      const along = dot(offset, forward);
      const miss = Math.sqrt(Math.max(0, dot(offset, offset) - along * along));
      const weight = point ? 1 / Math.max(0.02 * Math.abs(along), miss, 1e-9) : 1;
      for (let i = 0; i < 3; ++i)
        for (let j = 0; j < 3; ++j) {
          const across = weight * (Number(i === j) - forward[i] * forward[j]);
          a[i][j] += across;
          b[i] += across * position[j];
        }
    }
    point = solve(a, b);
    if (!point.every(Number.isFinite)) return undefined;
  }
  return cameras.filter((camera) => sees(camera, point!)).length >= cameras.length / 2 ? point : undefined;
}

/** Some Gaussians of a model, evenly chosen. */
export class ModelSample {
  private readonly step: number;
  private readonly centers: Vector[] = [];
  /** Largest standard deviations, and what a Gaussian covers where it is seen from one unit away. */
  private readonly sizes: number[] = [];
  private readonly areas: number[] = [];
  private seen = 0;
  private known: { size: number; extent: Extent } | undefined;

  private readonly cameras: readonly View[];

  constructor(
    private readonly count: number,
    cameras: readonly View[] = [],
  ) {
    this.step = Math.max(1, Math.ceil(count / MOST_SAMPLES));
    this.cameras = some(cameras, MOST_CAMERAS);
  }

  /** Takes the next texels of packed geometry. */
  add(texels: Uint32Array): void {
    const end = Math.min(this.seen + texels.length / 4, this.count);
    for (let i = this.centers.length * this.step; i < end; i += this.step) {
      const [color, xy, z, shape] = texels.subarray(4 * (i - this.seen), 4 * (i - this.seen) + 4);
      this.centers.push([halfToFloat(xy & 0xffff), halfToFloat(xy >>> 16), halfToFloat(z & 0xffff)]);
      const [, middle, largest] = [0, 8, 16].map((shift) => decodeScale((shape >>> shift) & 255)).sort((a, b) => a - b);
      this.sizes.push(largest);
      this.areas.push((2 * Math.PI * middle * largest * (color >>> 24)) / 255);
    }
    this.seen += texels.length / 4;
  }

  get isEmpty(): boolean {
    return this.centers.length === 0;
  }

  /**
   * The sphere that shows the model: around what the cameras look at and not beyond them, or where they look at nothing
   * in common, around the middle. A few Gaussians far away do not count: surroundings k times as far belong to it if
   * they have at least the square root of k times as many Gaussians. What no camera sees does not count, either.
   */
  extent(): Extent {
    const { centers, cameras } = this;
    if (this.known?.size === centers.length) return this.known.extent;
    const isSeen = centers.map((center) => cameras.some((camera) => sees(camera, center)));
    const isAny = isSeen.some(Boolean);
    const rows = centers.map((_, i) => i).filter((i) => !isAny || isSeen[i]);
    const focus = focusOf(cameras);
    let extent: Extent = { center: [0, 0, 0], radius: 1 };
    if (rows.length > 0 && focus) {
      const ring = median(cameras.map(({ position }) => distance(position, focus)));
      extent = { center: focus, radius: Math.min(ring, this.main(rows, focus).radius) };
    } else if (rows.length > 0) {
      const axes = [0, 1, 2];
      const part = this.main(rows, axes.map((axis) => median(rows.map((i) => centers[i][axis]))) as Vector).rows;
      const middle = axes.map((axis) => {
        const values = Float64Array.from(part, (i) => centers[i][axis]).sort();
        const last = values.length - 1;
        const cut = Math.floor(((1 - MIDDLE) / 2) * last);
        return (values[cut] + values[last - cut]) / 2;
      }) as Vector;
      extent = { center: middle, radius: this.main(part, middle).radius };
    }
    this.known = { size: centers.length, extent };
    return extent;
  }

  /** The sphere around `center` in which the main part of some Gaussians is, at least a half, and that part. */
  private main(rows: number[], center: Vector): { radius: number; rows: number[] } {
    const reach = (i: number) => distance(this.centers[i], center) + REACH * this.sizes[i];
    const sorted = rows.map((i): [number, number] => [reach(i), i]).sort(([a], [b]) => a - b);
    let best = sorted.length - 1;
    let most = -1;
    for (let k = (sorted.length - 1) >> 1; k < sorted.length; ++k) {
      const value = (k + 1) / Math.sqrt(Math.max(sorted[k][0], 1e-9));
      if (value >= most) [best, most] = [k, value];
    }
    return { radius: sorted[best][0], rows: sorted.slice(0, best + 1).map(([, i]) => i) };
  }

  /** The share of a picture, about, that is covered by what is nearer than `depth`. */
  covered({ position, right, down, forward, fx, fy, cx, cy, width, height }: View, depth: number): number {
    let thickness = 0;
    for (let i = 0; i < this.centers.length; ++i) {
      const offset = minus(this.centers[i], position);
      const z = dot(offset, forward);
      if (!(z > 0 && z < depth)) continue;
      const x = cx + (fx * dot(offset, right)) / z;
      const y = cy + (fy * dot(offset, down)) / z;
      if (x >= 0 && x <= width && y >= 0 && y <= height)
        thickness += Math.min(1, (fx * fy * this.areas[i]) / (z * z * width * height));
    }
    return 1 - Math.exp(-this.step * thickness);
  }
}
