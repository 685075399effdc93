// SPDX-License-Identifier: Apache-2.0
// Half-precision numbers (IEEE 754 binary16).

/** The value of 16 bits. */
export function halfToFloat(bits: number): number {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 0x1f;
  const mantissa = bits & 0x3ff;
  if (exponent === 0) return sign * mantissa * 2 ** -24;
  if (exponent === 0x1f) return mantissa ? NaN : sign * Infinity;
  return sign * (1 + mantissa / 1024) * 2 ** (exponent - 15);
}

const EXPONENT = 0x7c00;

/** Whether the lower half of a word is a number. */
export const isFiniteHalf = (word: number): boolean => (word & EXPONENT) !== EXPONENT;

/** Whether both halves of all words are numbers. */
export function areFiniteHalves(words: Uint32Array): boolean {
  for (let i = 0; i < words.length; ++i) if (!isFiniteHalf(words[i]) || !isFiniteHalf(words[i] >>> 16)) return false;
  return true;
}

const float = new Float32Array(1);
const bits = new Uint32Array(float.buffer);
const LARGEST_HALF = 65504;

/** The 16 bits of the nearest value; beyond ±65504 those of that. */
export function floatToHalf(value: number): number {
  float[0] = Math.min(Math.max(value, -LARGEST_HALF), LARGEST_HALF);
  const sign = (bits[0] >>> 16) & 0x8000;
  const size = Math.abs(float[0]);
  if (size < 2 ** -14) return sign | Math.round(size * 2 ** 24); // subnormal: steps of 2^-24
  const magnitude = (bits[0] & 0x7fffffff) - ((127 - 15) << 23);
  return sign | ((magnitude + 0xfff + ((magnitude >>> 13) & 1)) >>> 13); // to the nearest, ties to even
}
