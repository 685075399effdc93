// SPDX-License-Identifier: Apache-2.0
// Gaussians of another program's file, one row of numbers each, before they are packed (scene_packer.ts).

import { FormatError } from './cursor';
import type { ColorActivation } from './ngsplat';
import type { Vector } from './vector';

/**
 * Where the numbers of a row begin: mean, standard deviations, rotation w, x, y, z of any length, opacity from 0 to 1,
 * base colour before the activation, and coefficients of the spherical harmonics from degree 1 on, of which red, green
 * and blue stand side by side.
 */
export const MEAN = 0;
export const SCALE = 3;
export const ROTATION = 6;
export const OPACITY = 10;
export const BASE = 11;
export const REST = 14;

/** The highest degree of spherical harmonics that the viewer draws. */
export const MOST_DEGREE = 3;
/** Numbers of degrees 1 to `degree`. */
export const restWidth = (degree: number): number => 3 * (degree * (degree + 2));
export const rowWidth = (degree: number): number => REST + restWidth(degree);

/** The constant basis function, by which files multiply the base colour. */
export const Y0 = 0.28209479177387814;

export interface GaussianSource {
  count: number;
  /** Spherical harmonics, from 0 to MOST_DEGREE. */
  degree: number;
  up: Vector;
  /** Whether the Gaussians were trained with a smaller dilation and opacity that compensates for it. */
  antialiased: boolean;
  colorActivation: ColorActivation;
  /** Fills a row. What is not finite is left out later. */
  read(index: number, row: Float64Array): void;
  /** What the user should know of the file. */
  remarks: string[];
}

/** Zeroed memory. Throws FormatError where there is too little. */
export function allocate<T>(array: new (length: number) => T, length: number): T {
  try {
    return new array(length);
  } catch {
    throw new FormatError(`this browser cannot give memory for ${length} numbers of the model`);
  }
}
