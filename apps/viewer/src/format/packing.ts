// SPDX-License-Identifier: Apache-2.0
// Reads appearance/<folder>/packing.json of a model, and computes the sizes that follow from it for one file
// (docs/formats.md).

import { FormatError } from './cursor';
import { evaluate, type Values } from './expression';

/** Expressions are of the header's fields and of the `values` before them. */
export interface PackingDescription {
  /** The model's number in the file. */
  id: number;
  name: string;
  /** The file beside packing.json that has `residual()`. */
  glsl: string;
  /** Numbers in the header that only this model has. */
  floats?: { name: string; count: number };
  values?: Record<string, string>;
  /** What has to hold, and which field is wrong where it does not. */
  require?: { field: string; is: string; expected: string }[];
  /** Textures in front of those with the halves. */
  textures?: { words: 2 | 4; count: string }[];
  /** Half-precision numbers of a Gaussian, and those that all share. */
  halves?: string;
  weightHalves?: string;
  /** What the model's GLSL is told of the file. */
  constants?: Record<string, string>;
}

/** Textures of a Gaussian's words, consecutive ones of one kind together. */
export interface TextureShape {
  words: 2 | 4;
  layers: number;
}

export interface PackedLayout {
  textures: TextureShape[];
  /** The last layers of the last texture, which hold halves. */
  halfLayers: number;
  weightHalves: number;
  constants: Record<string, number>;
}

/** Most textures of one kind, half-precision numbers of one Gaussian, and numbers that all share. */
const MOST_TEXTURES = 16;
const MOST_HALVES = 64;
const MOST_WEIGHTS = 1 << 24;
const HALVES_PER_TEXEL = 8;

/** Throws FormatError saying which field of the header, or which size, cannot be. */
export function packedLayout(packing: PackingDescription, fields: Values): PackedLayout {
  const values: Record<string, number> = { ...fields };
  for (const [name, expression] of Object.entries(packing.values ?? {})) values[name] = evaluate(expression, values);
  for (const { field, is, expected } of packing.require ?? []) {
    if (!evaluate(is, values)) throw new FormatError(`${field} is ${values[field]}, expected ${expected}`);
  }
  const size = (expression: string, most: number): number => {
    const value = evaluate(expression, values);
    if (!(Number.isInteger(value) && value >= 0 && value <= most))
      throw new FormatError(
        `the header asks for ${value} as '${expression}', which is not a whole number up to ${most}`,
      );
    return value;
  };
  const textures: TextureShape[] = [];
  const add = (words: 2 | 4, layers: number) => {
    const last = textures.at(-1);
    if (last?.words === words) last.layers += layers;
    else if (layers > 0) textures.push({ words, layers });
  };
  for (const { words, count } of packing.textures ?? []) add(words, size(count, MOST_TEXTURES));
  const halfLayers = Math.ceil(size(packing.halves ?? '0', MOST_HALVES) / HALVES_PER_TEXEL);
  add(4, halfLayers);
  const constants = Object.entries(packing.constants ?? {}).map(
    ([name, expression]) => [name, evaluate(expression, values)] as const,
  );
  return {
    textures,
    halfLayers,
    weightHalves: size(packing.weightHalves ?? '0', MOST_WEIGHTS),
    constants: Object.fromEntries(constants),
  };
}
