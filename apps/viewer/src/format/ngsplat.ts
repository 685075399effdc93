// SPDX-License-Identifier: Apache-2.0
// The header of an .ngsplat file (docs/formats.md): sizes, cameras, photometric correction and weights, and where the
// texels lie that follow. What differs between models their packing.json says.

import { FormatError, type Cursor } from './cursor';
import { isFiniteHalf } from './half';
import { packedLayout, type TextureShape } from './packing';
import type { Trailer } from './trailer';
import { dot, type Vector } from './vector';
import { models, type ModelCode } from '../models';

/** Most pixels of a test camera in each direction. */
const MOST_PIXELS = 65535;
/** What rounding may leave of the lengths of a camera's axes, and of the angles between them. */
const AXES_TOLERANCE = 1e-2;

/** Into how many classes of importance gsapp divides a model (lib/export/file_rows.h). */
export const IMPORTANCE_CLASSES = 16;
/** Texels in a row. */
export const TEXTURE_WIDTH = 2048;

export enum ColorActivation {
  Relu,
  Softplus,
  Sigmoid,
  SaturatingExp,
  HardSigmoid,
  None,
}
export enum ResidualActivation {
  None,
  Tanh,
  Softplus,
}

/**
 * A pinhole camera: world from camera, OpenCV axes (columns right, down, forward, then the position), and intrinsics in
 * pixels.
 */
export interface TestCamera {
  right: Vector;
  down: Vector;
  forward: Vector;
  position: Vector;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  width: number;
  height: number;
}

/** What the camera did to the picture: exposure in stops and 8 colour latents per view, one response for all. */
export interface Photometric {
  /** Per channel toe, shoulder, gamma, center, a, b. */
  response: Float32Array;
  /** Exposure and latents of a view that is no test view. */
  neutral: Float32Array;
  testViews: Float32Array[];
}

/**
 * One block of texels: `words` unsigned integers (2 or 4) per texel, `layers` textures behind one another, of which the
 * last ones hold halves.
 */
export interface TexelBlock extends TextureShape {
  halfLayers: number;
  /** Empty where the texels went elsewhere. */
  data: Uint32Array;
}

/** Files by others have no trailer: their appearance is called as the format does, their background is black. */
export interface Scene extends Trailer {
  count: number;
  textureHeight: number;
  /**
   * Gaussians whose colour depends on the view, the first ones unless isInterleaved: only these have texels in the
   * payload.
   */
  numResiduals: number;
  /** Gaussians with and without a residual come by turns, class by class of importance. */
  isInterleaved: boolean;
  payloadHeight: number;
  model: ModelCode;
  /** What the model's GLSL is told of the file. */
  constants: Record<string, number>;
  /** Numbers in the header that only this model has. */
  floats: Float32Array;
  colorActivation: ColorActivation;
  residualActivation: ResidualActivation;
  antialiased: boolean;
  exponentialBase: boolean;
  baseScale: number;
  baseOffset: number;
  center: Vector;
  up: Vector;
  distance: number;
  testCameras: TestCamera[];
  photometric?: Photometric;
  /** Half-precision numbers, four to a texel. */
  weights: Uint16Array;
  /** Empty where the texels went elsewhere. */
  geometry: Uint32Array;
  payload: TexelBlock[];
}

function readTestCamera(c: Cursor): TestCamera {
  const m = c.floats(12, 'test camera');
  const column = (k: number): Vector => [m[k], m[4 + k], m[8 + k]];
  const [fx, fy, cx, cy, width, height] = c.floats(6, 'intrinsics of a test camera');
  const isSize = (n: number) => Number.isInteger(n) && n >= 1 && n <= MOST_PIXELS;
  if (!(isSize(width) && isSize(height) && fx > 0 && fy > 0))
    throw new FormatError(`a test camera has ${width} x ${height} pixels and focal lengths ${fx}, ${fy}`);
  const axes = [column(0), column(1), column(2)];
  for (let i = 0; i < 3; ++i)
    for (let j = 0; j <= i; ++j)
      if (Math.abs(dot(axes[i], axes[j]) - Number(i === j)) > AXES_TOLERANCE)
        throw new FormatError('the axes of a test camera are not unit and perpendicular');
  return { right: axes[0], down: axes[1], forward: axes[2], position: column(3), fx, fy, cx, cy, width, height };
}

/**
 * Everything in front of the texels, for which no memory is taken yet. Throws FormatError: Truncated where the header
 * goes on.
 */
export function readHeader(c: Cursor): Scene {
  if (c.text(8, 'magic') !== 'NGSPLAT\n')
    throw new FormatError('this is no .ngsplat file: it does not begin with NGSPLAT');
  const [
    count,
    width,
    textureHeight,
    featureDim,
    nFrequencies,
    shBandMask,
    colorActivation,
    residualActivation,
    nNeurons,
    nHiddenLayers,
    flags,
  ] = c.words(11, 'header');
  const flag = (bit: number) => ((flags >> bit) & 1) === 1;
  const id = ((flags >> 3) & 3) | (((flags >> 6) & 1) << 2);
  const model = models.get(id);
  if (!model) throw new FormatError(`appearance model number ${id} is unknown to this viewer; the file may be newer`);
  if (flags >> 10) throw new FormatError(`flags ${flags} are unknown to this viewer; the file may be newer`);
  if (width !== TEXTURE_WIDTH) throw new FormatError(`the texture width is ${width}, not ${TEXTURE_WIDTH}`);
  if (textureHeight !== Math.ceil(count / TEXTURE_WIDTH))
    throw new FormatError(`${count} Gaussians do not fill ${textureHeight} rows of ${TEXTURE_WIDTH}`);
  if (colorActivation > ColorActivation.None) throw new FormatError(`colour activation ${colorActivation} is unknown`);
  if (residualActivation > ResidualActivation.Softplus)
    throw new FormatError(`residual activation ${residualActivation} is unknown`);
  const { packing } = model;
  const layout = packedLayout(packing, {
    featureDim,
    nFrequencies,
    shBandMask,
    nNeurons,
    nHiddenLayers,
    constantInput: Number(!flag(1)),
    folded: Number(flag(2)),
  });
  const numResiduals = flag(8) ? c.word('number of residuals') : count;
  if (flag(8) && numResiduals >= count)
    throw new FormatError(`${numResiduals} of ${count} Gaussians have a residual, not fewer than all`);
  const [baseScale, baseOffset] = c.floats(2, 'range of the base colour');
  const floats = c.floats(packing.floats?.count ?? 0, packing.floats?.name ?? '');
  const center = [...c.floats(3, 'centre')] as Vector;
  const up = [...c.floats(3, 'up')] as Vector;
  const [distance] = c.floats(1, 'distance');

  const numCameras = c.word('number of test cameras');
  c.require(72 * numCameras, `${numCameras} test cameras`);
  const testCameras = Array.from({ length: numCameras }, () => readTestCamera(c));
  let photometric: Photometric | undefined;
  if (flag(7)) {
    const response = c.floats(18, 'response');
    const neutral = c.floats(9, 'exposure');
    photometric = { response, neutral, testViews: testCameras.map(() => c.floats(9, 'exposure of a test view')) };
  }

  const weightTexels = c.word('number of weight texels');
  if (4 * weightTexels !== layout.weightHalves)
    throw new FormatError(`the file has ${weightTexels} texels of weights, its model ${layout.weightHalves / 4}`);
  const weights = c.halves(layout.weightHalves, 'weights');
  if (!weights.every(isFiniteHalf)) throw new FormatError('a weight of the model is not finite');
  const payload = layout.textures.map((shape, k) => ({
    ...shape,
    halfLayers: k === layout.textures.length - 1 ? layout.halfLayers : 0,
    data: new Uint32Array(),
  }));
  return {
    count,
    textureHeight,
    numResiduals,
    payloadHeight: Math.ceil(numResiduals / TEXTURE_WIDTH),
    model,
    constants: layout.constants,
    floats,
    colorActivation,
    residualActivation,
    antialiased: flag(0),
    isInterleaved: flag(9),
    exponentialBase: flag(5),
    baseScale,
    baseOffset,
    center,
    up,
    distance,
    testCameras,
    photometric,
    weights,
    geometry: new Uint32Array(),
    payload,
    appearance: packing.name,
    background: [0, 0, 0],
  };
}
