// SPDX-License-Identifier: Apache-2.0
// What a model takes in memory, and what this device may give it.

const GIB = 2 ** 30;
/**
 * Bytes of a Gaussian beside its texels: its colour in half floats, its place in the order, and what the sorter keeps.
 */
const BESIDE = 8 + 4 + 26;
/** Browsers say at most this of larger memories. */
const PLENTY = 8;
/** The part of a device's memory that one page may take. */
const SHARE = 1 / 8;
/** For phones whose browser does not say how much memory there is. */
const UNKNOWN_PHONE = GIB / 4;

/** Bytes of a model of `count` Gaussians whose file, or whose texels, have so many. */
export const memoryOf = (bytes: number, count: number): number => bytes + BESIDE * count;

/** Bytes that a model may take here; Infinity where nothing speaks against a large one. */
export function memoryHere(): number {
  const { deviceMemory } = navigator as { deviceMemory?: number }; // GiB, rounded
  if (deviceMemory !== undefined) return deviceMemory < PLENTY ? SHARE * deviceMemory * GIB : Infinity;
  return matchMedia('(pointer: coarse)').matches && !matchMedia('(any-pointer: fine)').matches
    ? UNKNOWN_PHONE
    : Infinity;
}
