// SPDX-License-Identifier: Apache-2.0
// Reads .splat files: 32 bytes for each Gaussian (docs/formats.md), one colour each.

import { FormatError } from './cursor';
import { BASE, MEAN, OPACITY, ROTATION, SCALE, type GaussianSource } from './gaussian_source';
import { ColorActivation } from './ngsplat';

const RECORD = 32;

/** Throws FormatError where the length is not one of whole records. */
export function readSplat(buffer: ArrayBuffer): GaussianSource {
  const { byteLength } = buffer;
  if (byteLength % RECORD !== 0)
    throw new FormatError(
      `it has ${byteLength} bytes, which is no multiple of ${RECORD}: it is truncated, or no .splat file`,
    );
  const floats = new Float32Array(buffer);
  const bytes = new Uint8Array(buffer);
  return {
    count: byteLength / RECORD,
    degree: 0,
    up: [0, -1, 0],
    antialiased: false,
    colorActivation: ColorActivation.Relu,
    remarks: [],
    read: (i, row) => {
      for (let k = 0; k < 3; ++k) {
        row[MEAN + k] = floats[8 * i + k];
        row[SCALE + k] = floats[8 * i + 3 + k];
        row[BASE + k] = bytes[RECORD * i + 24 + k] / 255;
      }
      row[OPACITY] = bytes[RECORD * i + 27] / 255;
      for (let k = 0; k < 4; ++k) row[ROTATION + k] = (bytes[RECORD * i + 28 + k] - 128) / 128;
    },
  };
}
