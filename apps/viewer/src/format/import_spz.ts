// SPDX-License-Identifier: Apache-2.0
// Reads .spz files, versions 1 to 4.

import {
  BASE,
  MEAN,
  MOST_DEGREE,
  OPACITY,
  REST,
  ROTATION,
  SCALE,
  Y0,
  restWidth,
  type GaussianSource,
} from './gaussian_source';
import { halfToFloat } from './half';
import { ColorActivation } from './ngsplat';
import { readGzipBlocks, readZstdBlocks } from './spz_blocks';

/** Bit of the flags. */
const ANTIALIASED = 1;
/** What a step of a colour's byte is, in units of the constant coefficient. */
const COLOR_SCALE = 0.15;
/**
 * Signs of the basis functions of degrees 1 to 3 where y and z change theirs: the format's axes are right, up and back,
 * those of .ply files right, down and forward.
 */
const TURNED = [-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1];

/** Three numbers of the quaternion in 8 bits each; the fourth, w, is not negative. */
function readThree(bytes: Uint8Array, at: number, row: Float64Array): void {
  let squares = 0;
  for (let k = 0; k < 3; ++k) {
    const value = bytes[at + k] / 127.5 - 1;
    row[ROTATION + 1 + k] = value;
    squares += value * value;
  }
  row[ROTATION] = Math.sqrt(Math.max(0, 1 - squares));
}

/** Sign and 9 bits of each number but the largest, the last number lowest; then which of x, y, z, w is the largest. */
function readSmallestThree(bytes: Uint8Array, at: number, row: Float64Array): void {
  const word = (bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16) | (bytes[at + 3] << 24)) >>> 0;
  const largest = word >>> 30;
  let squares = 0;
  for (let k = 3, shift = 0; k >= 0; --k) {
    if (k === largest) continue;
    const size = (Math.SQRT1_2 * ((word >>> shift) & 511)) / 511;
    const value = (word >>> (shift + 9)) & 1 ? -size : size;
    row[ROTATION + ((k + 1) & 3)] = value; // w comes first in a row
    squares += value * value;
    shift += 10;
  }
  row[ROTATION + ((largest + 1) & 3)] = Math.sqrt(Math.max(0, 1 - squares));
}

/** Throws FormatError, which says what is wrong. Axes are turned to those of .ply files. */
export async function readSpz(buffer: ArrayBuffer, isGzip: boolean): Promise<GaussianSource> {
  const { header, blocks } = isGzip ? await readGzipBlocks(buffer) : readZstdBlocks(buffer);
  const { version, count, fractionalBits } = header;
  const [positions, alphas, colors, scales, rotations, rest] = blocks;
  const degree = Math.min(header.degree, MOST_DEGREE);
  const restBytes = restWidth(header.degree);
  const restKept = restWidth(degree);
  const step = 2 ** -fractionalBits;
  const readRotation = version >= 3 ? readSmallestThree : readThree;
  const rotationBytes = version >= 3 ? 4 : 3;
  const position =
    version === 1
      ? (n: number) => halfToFloat(positions[2 * n] | (positions[2 * n + 1] << 8))
      : (n: number) =>
          (((positions[3 * n] << 8) | (positions[3 * n + 1] << 16) | (positions[3 * n + 2] << 24)) >> 8) * step;
  return {
    count,
    degree,
    up: [0, -1, 0],
    antialiased: (header.flags & ANTIALIASED) !== 0,
    colorActivation: ColorActivation.Relu,
    remarks:
      header.degree > degree
        ? [`Of its spherical harmonics of degree ${header.degree}, those up to degree ${degree} are shown.`]
        : [],
    read: (i, row) => {
      for (let k = 0; k < 3; ++k) {
        row[MEAN + k] = k === 0 ? position(3 * i) : -position(3 * i + k);
        row[SCALE + k] = Math.exp(scales[3 * i + k] / 16 - 10);
        row[BASE + k] = (Y0 * (colors[3 * i + k] / 255 - 0.5)) / COLOR_SCALE + 0.5;
      }
      row[OPACITY] = alphas[i] / 255;
      readRotation(rotations, i * rotationBytes, row);
      const [w, x, y, z] = row.subarray(ROTATION, ROTATION + 4);
      row.set([-x, w, -z, y], ROTATION); // half a turn about x
      for (let k = 0; k < restKept; ++k)
        row[REST + k] = (TURNED[Math.floor(k / 3)] * (rest[restBytes * i + k] - 128)) / 128;
    },
  };
}
