// SPDX-License-Identifier: Apache-2.0
// Packs Gaussians of other programs' files into the scene that the viewer draws, with the rounding of an .ngsplat file.

import { bandCode, findBandScale, findBaseRange } from './code_range';
import { FormatError, LARGEST_NUMBER } from './cursor';
import {
  allocate,
  MEAN,
  MOST_DEGREE,
  REST,
  restWidth,
  ROTATION,
  rowWidth,
  SCALE,
  type GaussianSource,
} from './gaussian_source';
import { encodeGeometry } from './geometry_codes';
import { ResidualActivation, TEXTURE_WIDTH, type Scene, type TexelBlock } from './ngsplat';
import { packedLayout } from './packing';
import type { Vector } from './vector';
import { models } from '../models';

export interface Imported {
  scene: Scene;
  /** What the user should know of the file. */
  remarks: string[];
}

/**
 * The number of spherical harmonics among the models, and the bits of its coefficients in bands 1 to 3
 * (docs/formats.md).
 */
const SH_MODEL = 1;
const BAND_BITS = [7, 8, 6];
/** Rows that the choice of ranges, centre and size looks at. */
const MOST_SAMPLES = 8192;
/** Quaternions shorter than the square root of this have no direction. */
const LEAST_NORM2 = 1e-24;

function isDrawable(row: Float64Array): boolean {
  for (let k = 0; k < row.length; ++k) if (!(Math.abs(row[k]) <= LARGEST_NUMBER)) return false;
  return row[ROTATION] ** 2 + row[ROTATION + 1] ** 2 + row[ROTATION + 2] ** 2 + row[ROTATION + 3] ** 2 >= LEAST_NORM2;
}

const median = (values: number[]): number => values.sort((a, b) => a - b)[values.length >> 1] ?? 0;

/** The frame in which half-precision means and the near plane suit the model: x' = scale * (x - center). */
interface Frame {
  center: Vector;
  scale: number;
  /** Median distance of the Gaussians from their centre, in the frame. */
  spread: number;
}

/** A model below this is a point. */
const LEAST_EXTENT = 1e-9;
/** Spreads, and an offset by spreads, that need no other frame; and what the spread becomes where one is needed. */
const LEAST_SPREAD = 0.1;
const MOST_SPREAD = 1000;
const MOST_OFFSET = 4;
const USUAL_SPREAD = 4;

function findFrame(rows: Float64Array[]): { middle: Vector; frame: Frame } {
  const middle = [0, 1, 2].map((axis) => median(rows.map((row) => row[MEAN + axis]))) as Vector;
  const distance = median(
    rows.map((row) => Math.hypot(row[MEAN] - middle[0], row[MEAN + 1] - middle[1], row[MEAN + 2] - middle[2])),
  );
  const size = median(rows.map((row) => Math.max(row[SCALE], row[SCALE + 1], row[SCALE + 2])));
  const extent = Math.max(distance, 3 * size);
  const spread = extent > LEAST_EXTENT ? extent : 1;
  const usual = spread >= LEAST_SPREAD && spread <= MOST_SPREAD;
  const near = Math.hypot(...middle) <= MOST_OFFSET * spread;
  const scale = usual ? 1 : USUAL_SPREAD / spread;
  return { middle, frame: { center: usual && near ? [0, 0, 0] : middle, scale, spread: scale * spread } };
}

/**
 * Puts `value` at field `index` of `bits` bits, two's complement, of zeroed words that are one number from the lowest
 * bit on.
 */
function setField(words: Uint32Array, at: number, index: number, bits: number, value: number): void {
  const bit = index * bits;
  const shift = bit & 31;
  const code = value & ((1 << bits) - 1);
  at += bit >> 5;
  words[at] |= code << shift;
  if (shift + bits > 32) words[at + 1] |= code >>> (32 - shift);
}

/** Where the words of a band begin, and how many a Gaussian has. */
interface Place {
  data: Uint32Array;
  begin: number;
  words: number;
}

/**
 * A band of spherical harmonics: its numbers in a row, and the range and place of their codes. `limit` is the largest,
 * and stands for `scale`.
 */
interface Band extends Place {
  first: number;
  fields: number;
  bits: number;
  limit: number;
  scale: number;
}

function makeBands(samples: Float64Array[], places: Place[]): Band[] {
  return places.map((place, k) => {
    const first = REST + restWidth(k);
    const fields = restWidth(k + 1) - restWidth(k);
    const bits = BAND_BITS[k];
    const limit = (1 << (bits - 1)) - 1;
    return { ...place, first, fields, bits, limit, scale: findBandScale(samples, first, fields, limit) };
  });
}

/** The Gaussians that can be drawn. Throws FormatError where there is none. */
function findDrawable(source: GaussianSource, row: Float64Array): Uint32Array {
  const kept = allocate(Uint32Array, source.count);
  let count = 0;
  for (let i = 0; i < source.count; ++i) {
    source.read(i, row);
    if (isDrawable(row)) kept[count++] = i;
  }
  if (count === 0)
    throw new FormatError(source.count ? 'none of its Gaussians has finite numbers' : 'it holds no Gaussians');
  return kept.subarray(0, count);
}

function sampleRows(source: GaussianSource, kept: Uint32Array, width: number): Float64Array[] {
  const length = Math.min(kept.length, MOST_SAMPLES);
  return Array.from({ length }, (_, k) => {
    const sample = new Float64Array(width);
    source.read(kept[Math.floor((k * kept.length) / length)], sample);
    return sample;
  });
}

function remarksOn(source: GaussianSource, count: number, { center, scale }: Frame): string[] {
  const remarks = [...source.remarks];
  const broken = source.count - count;
  if (broken > 0)
    remarks.push(
      `${broken} of ${source.count} Gaussians are left out, because a number of theirs is not finite or their rotation is zero.`,
    );
  const enlarged = scale === 1 ? '' : `${scale.toPrecision(3)} times as large, and `;
  if (enlarged || center.some((c) => c !== 0))
    remarks.push(
      `Its coordinates are shown ${enlarged}relative to (${center.map((c) => c.toPrecision(4)).join(', ')}).`,
    );
  return remarks;
}

/** Throws FormatError where nothing of the source can be drawn. */
export function packScene(source: GaussianSource): Imported {
  const { degree, colorActivation, antialiased, up } = source;
  const row = new Float64Array(rowWidth(degree));
  const kept = findDrawable(source, row);
  const count = kept.length;
  const samples = sampleRows(source, kept, row.length);
  const { middle, frame } = findFrame(samples);
  const { center, scale } = frame;

  const model = models.get(SH_MODEL)!;
  const fields = {
    featureDim: 0,
    nFrequencies: 0,
    shBandMask: (2 << degree) - 2,
    nNeurons: 0,
    nHiddenLayers: 0,
    constantInput: 1,
    folded: 0,
  };
  const layout = packedLayout(model.packing, fields);
  const range = findBaseRange(samples, degree, colorActivation);

  const textureHeight = Math.ceil(count / TEXTURE_WIDTH);
  const texels = TEXTURE_WIDTH * textureHeight;
  const geometry = allocate(Uint32Array, 4 * texels);
  const payload: TexelBlock[] = layout.textures.map((shape) => ({
    ...shape,
    halfLayers: 0,
    data: allocate(Uint32Array, shape.words * shape.layers * texels),
  }));
  // The bands lie in the textures one after another.
  const places = payload.flatMap(({ words, layers, data }) =>
    Array.from({ length: layers }, (_, layer) => ({ words, data, begin: words * texels * layer })),
  );
  const bands = makeBands(samples, places);
  for (let i = 0; i < count; ++i) {
    source.read(kept[i], row);
    for (let k = 0; k < 3; ++k) {
      row[MEAN + k] = scale * (row[MEAN + k] - center[k]);
      row[SCALE + k] *= scale;
    }
    encodeGeometry(row, range, geometry, 4 * i);
    for (const band of bands) {
      const at = band.begin + band.words * i;
      for (let f = 0; f < band.fields; ++f)
        setField(band.data, at, f, band.bits, bandCode(row[band.first + f], band.scale, band.limit));
    }
  }
  const floats = new Float32Array(MOST_DEGREE);
  floats.set(bands.map((band) => band.scale));
  return {
    remarks: remarksOn(source, count, frame),
    scene: {
      count,
      textureHeight,
      numResiduals: count,
      isInterleaved: false,
      payloadHeight: textureHeight,
      model,
      constants: layout.constants,
      floats,
      colorActivation,
      antialiased,
      up,
      geometry,
      payload,
      residualActivation: ResidualActivation.None,
      exponentialBase: false,
      baseScale: range.scale,
      baseOffset: range.offset,
      center: middle.map((c, axis) => scale * (c - center[axis])) as Vector,
      distance: 1.5 * frame.spread,
      testCameras: [],
      weights: new Uint16Array(),
      appearance: degree > 0 ? model.packing.name : 'none',
      background: [0, 0, 0],
    },
  };
}
