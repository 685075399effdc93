// SPDX-License-Identifier: Apache-2.0
// Geometry and base colour of a Gaussian in 16 bytes (docs/formats.md), as lib/export/geometry_codes.cpp packs them.

import { BASE, MEAN, OPACITY, ROTATION, SCALE } from './gaussian_source';
import { floatToHalf } from './half';

/** Base colours are code * scale + offset. */
export interface BaseRange {
  scale: number;
  offset: number;
}

const LN_SMALLEST = -12;
const LN_RANGE = 21;
const STEPS = 254;
const STEP_RATIO = Math.exp(LN_RANGE / STEPS);

const byteCode = (x: number): number => Math.min(Math.max(Math.round(x), 0), 255);
const word = (a: number, b: number, c: number, d: number): number => (a | (b << 8) | (c << 16) | (d << 24)) >>> 0;
const sign = (x: number): number => (x < 0 ? -1 : 1);

export const baseCode = (value: number, range: BaseRange): number => byteCode((value - range.offset) / range.scale);

function scaleCode(size: number): number {
  if (size === 0) return 0;
  return Math.min(
    255,
    1 + Math.round(Math.max(0, ((Math.log(Math.max(size, 1e-30)) - LN_SMALLEST) * STEPS) / LN_RANGE)),
  );
}
export const decodeScale = (code: number): number =>
  code === 0 ? 0 : Math.exp(LN_SMALLEST + ((code - 1) * LN_RANGE) / STEPS);

/** The mean area of an ellipsoid's projections, up to a factor (Thomsen's approximation). */
function meanArea(x: number, y: number, z: number): number {
  return ((x * y) ** 1.6 + (x * z) ** 1.6 + (y * z) ** 1.6) ** (1 / 1.6);
}

/** The rotations of a cube: quaternions w, x, y, z, and the old axis (perhaps reversed) that each new axis is. */
const CUBE: { q: number[]; axes: number[] }[] = [];
const HALF = Math.SQRT1_2;
for (const q of [
  [1, 0, 0, 0],
  [0, 1, 0, 0],
  [0, 0, 1, 0],
  [0, 0, 0, 1],
  ...[1, 2, 3].flatMap((k) => [-HALF, HALF].map((s) => [HALF, 0, 0, 0].map((w, i) => (i === k ? s : w)))),
  ...[
    [1, 2],
    [1, 3],
    [2, 3],
  ].flatMap(([j, k]) => [-HALF, HALF].map((s) => [0, 0, 0, 0].map((_, i) => (i === j ? HALF : i === k ? s : 0)))),
  ...[0, 1, 2, 3, 4, 5, 6, 7].map((b) => [0.5, b & 1 ? 0.5 : -0.5, b & 2 ? 0.5 : -0.5, b & 4 ? 0.5 : -0.5]),
]) {
  const [w, x, y, z] = q;
  const columns = [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
  CUBE.push({ q, axes: columns.map((column) => column.findIndex((v) => Math.abs(v) > 0.5)) });
}

/** Writes the four words of a row. Its mean has to be finite and its rotation not zero. */
export function encodeGeometry(row: Float64Array, range: BaseRange, words: Uint32Array, at: number): void {
  // An ellipsoid has 24 rotations; the one of the least angle loses least when its axis is rounded.
  let [w, x, y, z] = [row[ROTATION], row[ROTATION + 1], row[ROTATION + 2], row[ROTATION + 3]];
  let most = -1;
  let best = CUBE[0];
  for (const candidate of CUBE) {
    const { q } = candidate;
    const real = Math.abs(w * q[0] - x * q[1] - y * q[2] - z * q[3]);
    if (real > most * (1 + 1e-9)) [most, best] = [real, candidate];
  }
  const [a, b, c, d] = best.q;
  const norm = Math.hypot(w, x, y, z);
  [w, x, y, z] = [
    w * a - x * b - y * c - z * d,
    w * b + x * a + y * d - z * c,
    w * c - x * d + y * a + z * b,
    w * d + x * c - y * b + z * a,
  ];
  const s = sign(w) / norm;
  w = Math.min(w * s, 1);
  const sum = (Math.abs(x) + Math.abs(y) + Math.abs(z)) / norm || 1; // without rotation any axis will do
  let u = (x * s) / sum;
  let v = (y * s) / sum;
  if (z * s < 0) [u, v] = [(1 - Math.abs(v)) * sign(u), (1 - Math.abs(u)) * sign(v)];

  const [p, q, r] = best.axes.map((axis) => row[SCALE + axis]);
  const [i, j, k] = [scaleCode(p), scaleCode(q), scaleCode(r)];
  // The opacity takes back half of what rounded scales change of the area, unless they lie outside of what the codes
  // hold.
  const ratio = meanArea(p, q, r) / meanArea(decodeScale(i), decodeScale(j), decodeScale(k));
  const opacity =
    ratio > 1 / STEP_RATIO && ratio < STEP_RATIO ? Math.min(1, row[OPACITY] * Math.sqrt(ratio)) : row[OPACITY];
  words[at] = word(
    baseCode(row[BASE], range),
    baseCode(row[BASE + 1], range),
    baseCode(row[BASE + 2], range),
    byteCode(255 * opacity),
  );
  words[at + 1] = (floatToHalf(row[MEAN]) | (floatToHalf(row[MEAN + 1]) << 16)) >>> 0;
  words[at + 2] = word(0, 0, byteCode((u / 2 + 0.5) * 255), byteCode((v / 2 + 0.5) * 255)) | floatToHalf(row[MEAN + 2]);
  words[at + 3] = word(i, j, k, byteCode((2 * Math.acos(w) * 255) / Math.PI));
}
