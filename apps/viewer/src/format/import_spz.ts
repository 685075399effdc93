// SPDX-License-Identifier: Apache-2.0
// Reads .spz files, versions 1 to 3: a gzip stream of a header and one block for each kind of number.

import { Cursor, FormatError } from './cursor';
import { BASE, MEAN, MOST_DEGREE, OPACITY, REST, ROTATION, SCALE, Y0, allocate, restWidth, type GaussianSource } from './gaussian_source';
import { halfToFloat } from './half';
import { ColorActivation } from './ngsplat';

const MAGIC = 0x5053474e, HEADER_BYTES = 16;
/** Bits of the flags. */
const ANTIALIASED = 1, EXTENDED = 2;
/** Degrees that the format knows. */
const MOST_FILE_DEGREE = 4;
/** Deflate packs no more than this into a byte. */
const MOST_INFLATION = 1032;
/** What a step of a colour's byte is, in units of the constant coefficient. */
const COLOR_SCALE = 0.15;
/** Signs of the basis functions of degrees 1 to 3 where y and z change theirs: the format's axes are right, up and back, those of .ply files right, down and forward. */
const TURNED = [-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1];

interface SpzHeader {
  version: number;
  count: number;
  degree: number;
  fractionalBits: number;
  flags: number;
}

/** Bytes of a Gaussian in each block, in the order of the file. */
function blockBytes({ version, degree }: SpzHeader): number[] {
  return [version === 1 ? 6 : 9, 1, 3, 3, version >= 3 ? 4 : 3, restWidth(degree)];
}

function readHeader(bytes: Uint8Array<ArrayBuffer>): SpzHeader {
  const c = new Cursor(bytes.slice(0, HEADER_BYTES).buffer);
  if (c.word('header') !== MAGIC) throw new FormatError('it is compressed with gzip, but what is inside does not begin as .spz does');
  const [version, count] = [c.word('header'), c.word('header')], [degree, fractionalBits, flags] = c.bytes(4, 'header');
  if (version < 1 || version > 3) throw new FormatError(`it is of version ${version}; the viewer reads versions 1 to 3`);
  if (degree > MOST_FILE_DEGREE) throw new FormatError(`its spherical harmonics have degree ${degree}, expected at most ${MOST_FILE_DEGREE}`);
  if (fractionalBits > 23) throw new FormatError(`its positions have ${fractionalBits} fractional bits, of 24 in all`);
  return { version, count, degree, fractionalBits, flags };
}

/** The header, and as many bytes as it declares, without what may follow as extensions. */
async function decompress(buffer: ArrayBuffer): Promise<{ header: SpzHeader; bytes: Uint8Array }> {
  const reader = new Blob([buffer]).stream().pipeThrough(new DecompressionStream('gzip')).getReader();
  const begin = new Uint8Array(HEADER_BYTES);
  let length = 0, header: SpzHeader | undefined, bytes: Uint8Array | undefined;
  try {
    for (;;) {
      const { done, value } = await reader.read().catch(() => {
        throw new FormatError('its gzip stream is truncated or damaged');
      });
      if (done) break;
      let part = value;
      if (!header) {
        const missing = part.subarray(0, HEADER_BYTES - length);
        begin.set(missing, length);
        length += missing.length;
        part = part.subarray(missing.length);
        if (length < HEADER_BYTES) continue;
        header = readHeader(begin);
        const size = header.count * blockBytes(header).reduce((sum, n) => sum + n, 0);
        if (size > MOST_INFLATION * buffer.byteLength) throw new FormatError(`the file is truncated: ${header.count} Gaussians take ${size} bytes, more than ${buffer.byteLength} can hold compressed`);
        bytes = allocate(Uint8Array, size);
        length = 0;
      }
      const room = bytes!.length - length;
      if (part.length > room && !(header.flags & EXTENDED)) throw new FormatError(`more follows than the ${header.count} Gaussians of its header`);
      bytes!.set(part.subarray(0, room), length);
      length += Math.min(part.length, room);
    }
  } finally {
    await reader.cancel().catch(() => undefined);
  }
  if (!header || !bytes) throw new FormatError('the file is truncated: its header is not complete');
  if (length < bytes.length) throw new FormatError(`the file is truncated: ${header.count} Gaussians take ${bytes.length} bytes, but only ${length} follow`);
  return { header, bytes };
}

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
  const word = (bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16) | (bytes[at + 3] << 24)) >>> 0, largest = word >>> 30;
  let squares = 0;
  for (let k = 3, shift = 0; k >= 0; --k) {
    if (k === largest) continue;
    const size = (Math.SQRT1_2 * ((word >>> shift) & 511)) / 511, value = (word >>> (shift + 9)) & 1 ? -size : size;
    row[ROTATION + ((k + 1) & 3)] = value; // w comes first in a row
    squares += value * value;
    shift += 10;
  }
  row[ROTATION + ((largest + 1) & 3)] = Math.sqrt(Math.max(0, 1 - squares));
}

/** Throws FormatError, which says what is wrong. Axes are turned to those of .ply files. */
export async function readSpz(buffer: ArrayBuffer): Promise<GaussianSource> {
  const { header, bytes } = await decompress(buffer), { version, count, fractionalBits } = header;
  const sizes = blockBytes(header), degree = Math.min(header.degree, MOST_DEGREE);
  let end = 0;
  const [positions, alphas, colors, scales, rotations, rest] = sizes.map((size) => bytes.subarray(end, (end += count * size)));
  const restBytes = sizes[5], restKept = restWidth(degree), step = 2 ** -fractionalBits, readRotation = version >= 3 ? readSmallestThree : readThree;
  const position = version === 1
    ? (n: number) => halfToFloat(positions[2 * n] | (positions[2 * n + 1] << 8))
    : (n: number) => (((positions[3 * n] << 8) | (positions[3 * n + 1] << 16) | (positions[3 * n + 2] << 24)) >> 8) * step;
  return {
    count, degree, up: [0, -1, 0], antialiased: (header.flags & ANTIALIASED) !== 0, colorActivation: ColorActivation.Relu,
    remarks: header.degree > degree ? [`Of its spherical harmonics of degree ${header.degree}, those up to degree ${degree} are shown.`] : [],
    read: (i, row) => {
      for (let k = 0; k < 3; ++k) {
        row[MEAN + k] = k === 0 ? position(3 * i) : -position(3 * i + k);
        row[SCALE + k] = Math.exp(scales[3 * i + k] / 16 - 10);
        row[BASE + k] = (Y0 * (colors[3 * i + k] / 255 - 0.5)) / COLOR_SCALE + 0.5;
      }
      row[OPACITY] = alphas[i] / 255;
      readRotation(rotations, i * sizes[4], row);
      const [w, x, y, z] = row.subarray(ROTATION, ROTATION + 4);
      row.set([-x, w, -z, y], ROTATION); // half a turn about x
      for (let k = 0; k < restKept; ++k) row[REST + k] = (TURNED[Math.floor(k / 3)] * (rest[restBytes * i + k] - 128)) / 128;
    },
  };
}
