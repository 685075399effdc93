// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Vector } from '../src/format/vector';
import { DepthSorter, NEAR_PLANE } from '../src/sort/sort';

/** Numbers in [0,1) that are the same every time. */
function random(seed: number): () => number {
  let s = seed;
  return () => ((s = (Math.imul(s, 1664525) + 1013904223) >>> 0), s / 2 ** 32);
}

function sorted(centers: Float32Array, position: Vector = [0, 0, 0], forward: Vector = [0, 0, 1]): Uint32Array {
  const order = new Uint32Array(centers.length / 3);
  return order.subarray(0, new DepthSorter(centers).sort(position, forward, order));
}

const alongZ = (...z: number[]) => new Float32Array(z.flatMap((v) => [0, 0, v]));

describe('DepthSorter', () => {
  it.each([1, 2, 1000, 100_000])('orders %i points back to front and leaves out those behind the near plane', (n) => {
    const r = random(n), centers = new Float32Array(3 * n).map(() => 20 * r() - 10);
    const position: Vector = [1, -2, 0.5], forward: Vector = [0.6, 0, 0.8];
    const depth = (i: number) => (centers[3 * i] - 1) * 0.6 + (centers[3 * i + 2] - 0.5) * 0.8;
    const order = sorted(centers, position, forward);
    for (let k = 1; k < order.length; ++k) expect(depth(order[k - 1]) - depth(order[k])).toBeGreaterThan(-1e-5); // rounding of the sums
    const near = Array.from({ length: n }, (_, i) => i).filter((i) => depth(i) > NEAR_PLANE + 1e-5), drawn = new Set(order);
    expect(near.every((i) => drawn.has(i))).toBe(true);
    expect([...drawn].every((i) => depth(i) > NEAR_PLANE - 1e-5)).toBe(true);
    expect(drawn.size).toBe(order.length);
  });

  it('keeps the resolution near by where one point is a million away', () => {
    expect([...sorted(alongZ(1, 1.000001, 1e6, 1.0000005))]).toEqual([2, 1, 3, 0]);
  });

  it('keeps the order of equally far points', () => {
    expect([...sorted(alongZ(5, 5, 5, 5))]).toEqual([0, 1, 2, 3]);
  });

  it('draws nothing of a scene behind the camera, nor of none', () => {
    expect(sorted(alongZ(-1, -5, 0, NaN)).length).toBe(0);
    expect(sorted(new Float32Array()).length).toBe(0);
  });

  it('can be asked again from elsewhere', () => {
    const sorter = new DepthSorter(alongZ(1, 2, 3)), order = new Uint32Array(3);
    expect(sorter.sort([0, 0, 0], [0, 0, 1], order)).toBe(3);
    expect([...order]).toEqual([2, 1, 0]);
    expect(sorter.sort([0, 0, 2.5], [0, 0, -1], order)).toBe(2);
    expect([...order.subarray(0, 2)]).toEqual([0, 1]);
  });
});
