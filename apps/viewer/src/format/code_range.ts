// SPDX-License-Identifier: Apache-2.0
// The ranges that the codes of a scene cover: outliers are cut off where that shows less error than coarse steps for
// all Gaussians. The choice is that of lib/export/geometry_codes.cpp and appearance/sh/packing.cpp, over a sample of the
// Gaussians.

import { BASE, OPACITY, REST } from './gaussian_source';
import { baseCode, type BaseRange } from './geometry_codes';
import { ColorActivation } from './ngsplat';

/**
 * The range's ends to consider: what leaves 0, 1, 2, 4, ... of the values outside; these are sorted, from the outermost
 * on.
 */
function possibleEnds(values: Float64Array): number[] {
  const ends = [values[0]];
  for (let outside = 1; outside < values.length / 4; outside *= 2) ends.push(values[outside]);
  return ends;
}

const HALF = Math.sqrt(1 / 3);
/** Corners of a tetrahedron, from which colours are looked at. */
const DIRECTIONS = [
  [HALF, HALF, HALF],
  [HALF, -HALF, -HALF],
  [-HALF, HALF, -HALF],
  [-HALF, -HALF, HALF],
];

/** Spherical harmonics of degrees 1 to 3 (appearance/sh/README.md). */
function basis([x, y, z]: number[]): number[] {
  return [
    -0.4886025119029199 * y,
    0.4886025119029199 * z,
    -0.4886025119029199 * x,
    1.0925484305920792 * x * y,
    -1.0925484305920792 * y * z,
    0.9461746957575601 * z * z - 0.31539156525252005,
    -1.0925484305920792 * x * z,
    0.5462742152960396 * (x * x - y * y),
    0.5900435899266435 * y * (y * y - 3 * x * x),
    2.890611442640554 * x * y * z,
    0.4570457994644658 * y * (1 - 5 * z * z),
    0.3731763325901154 * z * (5 * z * z - 3),
    0.4570457994644658 * x * (1 - 5 * z * z),
    1.445305721320277 * z * (x * x - y * y),
    0.5900435899266435 * x * (3 * y * y - x * x),
  ];
}
const BASES = DIRECTIONS.map(basis);

/**
 * A pixel's value of a Gaussian that nothing covers. A colour above 1 counts as long as its product with the opacity is
 * below 1.
 */
function shown(activation: ColorActivation, color: number, opacity: number): number {
  if (activation === ColorActivation.Sigmoid) color = 1 / (1 + Math.exp(-4 * color));
  else if (activation === ColorActivation.Softplus)
    color = Math.max(color, 0) + Math.log1p(Math.exp(-10 * Math.abs(color))) / 10;
  else color = Math.max(color, 0);
  if (activation === ColorActivation.HardSigmoid) color = Math.min(color, 1);
  return Math.min(opacity * color, 1);
}

/** The range of least squared error of what is seen of the sampled rows. */
export function findBaseRange(rows: Float64Array[], degree: number, activation: ColorActivation): BaseRange {
  if (rows.length === 0) return { scale: 1 / 255, offset: 0 };
  const values = Float64Array.from(rows.flatMap((row) => [row[BASE], row[BASE + 1], row[BASE + 2]])).sort();
  const directions = degree > 0 ? BASES : BASES.slice(0, 1);
  const terms = degree * (degree + 2);
  const channels = rows.flatMap((row) =>
    [0, 1, 2].map((c) => {
      const residuals = directions.map((y) => {
        let sum = 0;
        for (let k = 0; k < terms; ++k) sum += y[k] * row[REST + 3 * k + c];
        return sum;
      });
      return {
        base: row[BASE + c],
        opacity: row[OPACITY],
        residuals,
        shown: residuals.map((residual) => shown(activation, row[BASE + c] + residual, row[OPACITY])),
      };
    }),
  );
  const lows = possibleEnds(values);
  const highs = possibleEnds(values.reverse());
  let best: BaseRange = { scale: 1, offset: 0 };
  let least = Infinity;
  for (const low of lows) {
    for (const high of highs) {
      const range = { scale: Math.max(high - low, 1e-6) / 255, offset: low };
      let error = 0;
      for (const { base, opacity, residuals, shown: wanted } of channels) {
        if (error >= least) break;
        const rounded = baseCode(base, range) * range.scale + range.offset;
        for (let k = 0; k < residuals.length; ++k)
          error += (shown(activation, rounded + residuals[k], opacity) - wanted[k]) ** 2;
      }
      if (error < least) [least, best] = [error, range];
    }
  }
  return best;
}

/**
 * The coefficient that the largest code of a band, `limit`, stands for; the band's numbers are those from `first` on.
 */
export function findBandScale(rows: Float64Array[], first: number, count: number, limit: number): number {
  const sizes = Float64Array.from([
    1e-8,
    ...rows.flatMap((row) => Array.from(row.subarray(first, first + count), Math.abs)),
  ])
    .sort()
    .reverse();
  let best = 0;
  let least = Infinity;
  for (const scale of possibleEnds(sizes)) {
    if (scale === 0) continue;
    let error = 0;
    for (const row of rows) {
      for (let c = 0; c < 3; ++c) {
        let squares = 0;
        for (let f = c; f < count; f += 3)
          squares += (row[first + f] - (bandCode(row[first + f], scale, limit) * scale) / limit) ** 2;
        error += Math.min(1, (row[OPACITY] ** 2 * squares) / (4 * Math.PI)); // the basis functions are orthonormal
      }
    }
    if (error < least) [least, best] = [error, scale];
  }
  return best;
}

export const bandCode = (coefficient: number, scale: number, limit: number): number =>
  Math.min(Math.max(Math.round((coefficient / scale) * limit), -limit), limit);
