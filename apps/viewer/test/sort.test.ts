// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { camFromWorld, type View } from '../src/camera/view';
import { halfToFloat } from '../src/format/half';
import { dot, type Vector } from '../src/format/vector';
import { centersOf, DepthSorter, FAR_PLANE, NEAR_PLANE } from '../src/sort/sort';
import { toHalf } from './encode';

/** Numbers in [0,1) that are the same every time. */
function random(seed: number): () => number {
  let s = seed;
  return () => ((s = (Math.imul(s, 1664525) + 1013904223) >>> 0), s / 2 ** 32);
}

/** Everything in front of this camera is seen. */
const WIDE: View = {
  right: [1, 0, 0],
  down: [0, 1, 0],
  forward: [0, 0, 1],
  position: [0, 0, 0],
  fx: 1,
  fy: 1,
  cx: 5e4,
  cy: 5e4,
  width: 1e5,
  height: 1e5,
};
const LENS: View = { ...WIDE, fx: 90, fy: 100, cx: 45, cy: 35, width: 100, height: 60 };

/** A view with the same lens from elsewhere, turned by `angle` around the vertical. */
function turned(view: View, position: Vector, angle: number): View {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  return { ...view, position, right: [c, 0, -s], forward: [s, 0, c] };
}

/** Packed geometry, with the code of all standard deviations. */
function texels(points: number[][], scale = 0): Uint32Array {
  return Uint32Array.from(
    points.flatMap(([x, y, z]) => [
      0xff000000,
      toHalf(x) | (toHalf(y) << 16),
      toHalf(z),
      scale | (scale << 8) | (scale << 16),
    ]),
  );
}

function sorted(geometry: Uint32Array, view = WIDE): Uint32Array {
  const n = geometry.length / 4;
  const sorter = new DepthSorter(n);
  const order = new Uint32Array(n);
  sorter.add(geometry);
  return order.subarray(0, sorter.sort(view, 1, order));
}

const alongZ = (...z: number[]) => texels(z.map((v) => [0, 0, v]));
const randomPoints = (n: number, r: () => number, size = 20) =>
  Array.from({ length: n }, () => [0, 0, 0].map(() => size * (r() - 0.5)));

describe('DepthSorter', () => {
  it.each([1, 2, 1000, 100_000])('orders %i points back to front and leaves out those behind the near plane', (n) => {
    const geometry = texels(randomPoints(n, random(n)));
    const centers = centersOf(geometry);
    const view = turned(WIDE, [1, -2, 0.5], 0.64);
    const depth = (i: number) =>
      dot(view.forward, [0, 1, 2].map((k) => centers[3 * i + k] - view.position[k]) as Vector);
    const order = sorted(geometry, view);
    expect(order.findIndex((i, k) => k > 0 && depth(order[k - 1]) < (1 - 1e-5) * depth(i))).toBe(-1);
    const drawn = new Set(order);
    const near = Array.from({ length: n }, (_, i) => i).filter((i) => depth(i) >= NEAR_PLANE);
    expect(near.every((i) => drawn.has(i))).toBe(true);
    expect(drawn.size).toBe(near.length);
    expect(order.length).toBe(near.length);
  });

  it('keeps the resolution near by where one point is as far as can be seen', () => {
    expect([...sorted(alongZ(1, 1.002, 9000, 1.001))]).toEqual([2, 1, 3, 0]); // neighbours among half-precision numbers
  });

  it('keeps the order of equally far points', () => {
    expect([...sorted(alongZ(5, 5, 5, 5))]).toEqual([0, 1, 2, 3]);
  });

  it('draws nothing of a scene behind the camera or too far, nor of none', () => {
    expect(sorted(alongZ(-1, -5, 0, NEAR_PLANE / 2, 2 * FAR_PLANE)).length).toBe(0);
    expect(sorted(new Uint32Array()).length).toBe(0);
  });

  it('can be asked again from elsewhere, and takes what arrives meanwhile', () => {
    const sorter = new DepthSorter(3);
    const order = new Uint32Array(3);
    const view = { ...WIDE, position: [0, 0, 2.5] as Vector, forward: [0, 0, -1] as Vector };
    expect(sorter.sort(WIDE, 1, order)).toBe(0);
    sorter.add(alongZ(1, 2));
    expect([...order.subarray(0, sorter.sort(WIDE, 1, order))]).toEqual([1, 0]);
    sorter.add(alongZ(3, 4, 5)); // a row of a texture goes on behind the last Gaussian
    expect([...order.subarray(0, sorter.sort(WIDE, 1, order))]).toEqual([2, 1, 0]);
    expect([...order.subarray(0, sorter.sort(view, 1, order))]).toEqual([0, 1]);
  });
});

/**
 * Whether a Gaussian with these standard deviations along the camera's axes reaches a pixel: as splat.vert.glsl has it.
 */
function isSeen(view: View, p: Vector, s: Vector, margin: number): boolean {
  const { rotation: r, translation: t } = camFromWorld(view);
  const size = [view.width, view.height];
  const focal = [view.fx, view.fy];
  const center = [view.cx, view.cy];
  const cam = [0, 1, 2].map((i) => r[i] * p[0] + r[3 + i] * p[1] + r[6 + i] * p[2] + t[i]);
  if (!(cam[2] >= NEAR_PLANE && cam[2] <= FAR_PLANE)) return false;
  return [0, 1].every((k) => {
    const uv = cam[k] / cam[2];
    const slope = Math.min(
      Math.max(uv, (-0.15 * size[k] - center[k]) / focal[k]),
      (1.15 * size[k] - center[k]) / focal[k],
    );
    const deviation = Math.sqrt((focal[k] / cam[2]) ** 2 * (s[k] ** 2 + (slope * s[2]) ** 2) + 0.3);
    const reach = deviation * Math.sqrt(2 * Math.log(255));
    const pixel = focal[k] * uv + center[k];
    return pixel + reach >= -margin * size[k] && pixel - reach <= (1 + margin) * size[k];
  });
}

describe('culling', () => {
  it.each([1, 100, 150, 170])(
    'leaves out nothing that the picture shows, nor what a small turn brings into it (scale %i)',
    (code) => {
      const r = random(code);
      const points = randomPoints(20_000, r, 12);
      const geometry = texels(points, code);
      const centers = centersOf(geometry);
      const deviation = Math.exp(-12 + ((code - 1) * 21) / 254);
      const s: Vector = [deviation, deviation, deviation];
      let kept = 0;
      let missing = 0;
      let missingAfterTurn = 0;
      for (const angle of [0, 1, 2.5]) {
        const view = turned(LENS, [0.3, -0.2, -1], angle);
        const drawn = new Set(sorted(geometry, view));
        kept += drawn.size;
        for (let i = 0; i < points.length; ++i) {
          if (drawn.has(i)) continue;
          const p = [...centers.subarray(3 * i, 3 * i + 3)] as Vector;
          missing += Number(isSeen(view, p, s, 0.15));
          const isBehind = dot(p, view.forward) - dot(view.position, view.forward) < NEAR_PLANE;
          missingAfterTurn += Number(
            !isBehind && [-0.1, 0.1].some((turn) => isSeen(turned(LENS, view.position, angle + turn), p, s, -0.02)),
          );
        }
      }
      expect(missing).toBe(0);
      if (code < 150) expect(missingAfterTurn).toBe(0); // larger ones that are that near cover the picture anyway
      if (code < 150) expect(kept).toBeLessThan(0.5 * 3 * points.length); // else nothing would be gained
    },
  );

  it('counts larger scales', () => {
    const geometry = texels([[3, 0, 3]], 120);
    const sorter = new DepthSorter(1);
    const order = new Uint32Array(1);
    sorter.add(geometry);
    expect(sorter.sort(LENS, 1, order)).toBe(0);
    expect(sorter.sort(LENS, 10, order)).toBe(1);
  });
});

it('centersOf decodes half-precision numbers', () => {
  expect([...centersOf(texels([[1.5, -2, 0.25]]))]).toEqual([1.5, -2, 0.25]);
  expect(halfToFloat(toHalf(-0.333))).toBeCloseTo(-0.333, 3);
});
