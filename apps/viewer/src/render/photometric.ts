// SPDX-License-Identifier: Apache-2.0
// PPISP without vignetting: exposure and colour of one view, ready for its pixels (isp_color and isp_frame in
// kernels/ppisp/ppisp_device.h have the same).

import type { Vector } from '../format/vector';

/** Latents of the blue, red, green and neutral point are multiplied by these symmetric matrices (xx, xy, yy). */
const LATENT_SCALES = [
  [0.0480542, -0.0043631, 0.0481283],
  [0.058057, -0.0179872, 0.0431061],
  [0.0433336, -0.0180537, 0.05805],
  [0.0128369, -0.0034654, 0.0128158],
];
const POINTS = [
  [0, 0],
  [1, 0],
  [0, 1],
  [1 / 3, 1 / 3],
];
const SMALLEST_SCALE = 1e-6;

const cross = (a: Vector, b: Vector): Vector => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
const length2 = (a: Vector): number => a[0] * a[0] + a[1] * a[1] + a[2] * a[2];

/** The homography of chromaticities as it acts on (red, green, blue): nine numbers, row by row. */
export function colorMix(latents: ArrayLike<number>): number[] {
  const target = POINTS.map(([x, y], k): Vector => {
    const [xx, xy, yy] = LATENT_SCALES[k];
    const u = latents[2 * k];
    const v = latents[2 * k + 1];
    return [x + xx * u + xy * v, y + xy * u + yy * v, 1];
  });
  const columns = [0, 1, 2].map((k) => cross(target[3], target[k]));
  const rows = [0, 1, 2].map((i): Vector => [columns[0][i], columns[1][i], columns[2][i]]);
  // Weights that mix neutral from the three points. All pairs of rows give the same up to a factor; the longest lost
  // least to rounding.
  const lambda = [cross(rows[0], rows[1]), cross(rows[0], rows[2]), cross(rows[1], rows[2])].reduce((a, b) =>
    length2(b) > length2(a) ? b : a,
  );
  const mixed = [0, 1, 2].map((i): Vector => {
    const [b, r, g] = [0, 1, 2].map((k) => target[k][i] * lambda[k]);
    return [r - b, g - b, b];
  });
  const bound = Math.max(SMALLEST_SCALE * Math.max(...mixed.flat().map(Math.abs)), 1e-30);
  const element = mixed[2][2];
  const scale = Math.abs(element) >= bound ? element : element < 0 ? -bound : bound;
  // Intensity is the sum of the channels, and blue what is left of it.
  const onChannels = (m: Vector): Vector => [(m[0] + m[2]) / scale, (m[1] + m[2]) / scale, m[2] / scale];
  const [red, green, intensity] = mixed.map(onChannels);
  return [...red, ...green, ...intensity.map((x, i) => x - red[i] - green[i])];
}

/** 2^exposure, kept within 16 stops. */
export function gain(exposure: number): number {
  return 2 ** Math.min(16, Math.max(-16, exposure));
}

/**
 * Returns the uniforms of resolve.glsl for a photometric correction: exposure and latents of a view, and the response.
 */
export function correction(
  exposure: Float32Array | undefined,
  response: Float32Array | undefined,
): Record<string, boolean | number | ArrayLike<number>> {
  if (!exposure || !response) return { corrected: false };
  const [a, b, c, d, e, f, g, h, i] = colorMix(exposure.subarray(1));
  return { corrected: true, gain: gain(exposure[0]), mix_colors: [a, d, g, b, e, h, c, f, i], response };
}
