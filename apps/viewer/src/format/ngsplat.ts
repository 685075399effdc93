// SPDX-License-Identifier: Apache-2.0
// Reads an .ngsplat file (docs/formats.md): header, cameras, photometric correction, weights, and the blocks of texels, which
// stay views of the file's bytes.

import { Cursor, FormatError } from './cursor';
import { models, type ModelCode } from '../models';
import { readTrailer, type Trailer } from './trailer';

/** Texels in a row. */
export const TEXTURE_WIDTH = 2048;
/** Most half-precision numbers of one Gaussian. */
const MOST_HALVES = 64;
/** Largest network that is believed. */
const MOST_NEURONS = 256, MOST_LAYERS = 16;
/** Bits of one coefficient of spherical harmonics, by degree. */
const SH_BITS = [7, 8, 6];

/** Numbers of the models whose payload the format packs in its own way. */
export const NEURAL = 0;
export const SPHERICAL_HARMONICS = 1;

export enum ColorActivation { Relu, Softplus, Sigmoid, SaturatingExp, HardSigmoid, None }
export enum ResidualActivation { None, Tanh, Softplus }

/** A pinhole camera: world from camera, OpenCV axes (columns right, down, forward, then the position), and intrinsics in pixels. */
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
export type Vector = [number, number, number];

/** What the camera did to the picture: exposure in stops and 8 colour latents per view, one response for all. */
export interface Photometric {
  /** Per channel toe, shoulder, gamma, center, a, b. */
  response: Float32Array;
  /** Exposure and latents of a view that is no test view. */
  neutral: Float32Array;
  testViews: Float32Array[];
}

/** One block of texels: `words` unsigned integers (2 or 4) per texel, `layers` textures behind one another. */
export interface TexelBlock {
  words: 2 | 4;
  layers: number;
  data: Uint32Array;
}

/** Files by others have no trailer: their appearance is called as the format does, their background is black. */
export interface Scene extends Trailer {
  count: number;
  textureHeight: number;
  model: ModelCode;
  /** Sites or lobes, inputs of a network, or 0. */
  featureDim: number;
  colorActivation: ColorActivation;
  residualActivation: ResidualActivation;
  /** Highest stored degree of spherical harmonics; for networks of the direction's encoding. */
  degree: number;
  /** Of the network: whether degree l (bit l) of the direction is an input. */
  bandMask: number;
  neurons: number;
  hiddenLayers: number;
  antialiased: boolean;
  constantInput: boolean;
  foldedFirstLayer: boolean;
  exponentialBase: boolean;
  baseScale: number;
  baseOffset: number;
  /** Largest coefficient of each degree of spherical harmonics. */
  shScales: Vector;
  center: Vector;
  up: Vector;
  distance: number;
  testCameras: TestCamera[];
  photometric?: Photometric;
  /** Half-precision numbers, four to a texel. */
  weights: Uint16Array;
  geometry: Uint32Array;
  payload: TexelBlock[];
}

/** Directions that enter the first layer of a network, as stored: padded to a multiple of four. */
export function storedInputs(scene: Pick<Scene, 'featureDim' | 'bandMask' | 'constantInput' | 'foldedFirstLayer'>): number {
  let inputs = scene.foldedFirstLayer ? 0 : scene.featureDim + (scene.constantInput ? 1 : 0);
  for (let l = 1; l <= 3; ++l) if ((scene.bandMask >> l) & 1) inputs += 2 * l + 1;
  return 4 * Math.ceil(inputs / 4);
}

function readTestCamera(c: Cursor): TestCamera {
  const m = c.floats(12, 'test camera');
  const column = (k: number): Vector => [m[k], m[4 + k], m[8 + k]];
  const [fx, fy, cx, cy, width, height] = c.floats(6, 'intrinsics of a test camera');
  if (!(width >= 1 && height >= 1 && fx > 0 && fy > 0)) throw new FormatError(`a test camera has ${width} x ${height} pixels and focal lengths ${fx}, ${fy}`);
  return { right: column(0), down: column(1), forward: column(2), position: column(3), fx, fy, cx, cy, width, height };
}

/** Degree up to which bands are stored, without a gap. */
function contiguousDegree(mask: number): number {
  const degree = [0b0, 0b10, 0b110, 0b1110].indexOf(mask);
  if (degree < 0) throw new FormatError(`the bands of spherical harmonics (mask ${mask}) are not 1 up to at most 3`);
  return degree;
}

/** Throws FormatError, which says what is wrong, for anything but a complete file. */
export function parseScene(buffer: ArrayBuffer): Scene {
  const c = new Cursor(buffer);
  if (c.text(8, 'magic') !== 'NGSPLAT\n') throw new FormatError('this is no .ngsplat file: it does not begin with NGSPLAT');
  const [count, width, textureHeight, featureDim, , bandMask, colorActivation, residualActivation, neurons, hiddenLayers, flags] = c.words(11, 'header');
  const flag = (bit: number) => ((flags >> bit) & 1) === 1;
  const id = ((flags >> 3) & 3) | (((flags >> 6) & 1) << 2);
  const model = models.get(id);
  if (!model) throw new FormatError(`appearance model number ${id} is unknown to this viewer; the file may be newer`);
  if (flags >> 8) throw new FormatError(`flags ${flags} are unknown to this viewer; the file may be newer`);
  if (width !== TEXTURE_WIDTH) throw new FormatError(`the texture width is ${width}, not ${TEXTURE_WIDTH}`);
  if (textureHeight !== Math.ceil(count / TEXTURE_WIDTH)) throw new FormatError(`${count} Gaussians do not fill ${textureHeight} rows of ${TEXTURE_WIDTH}`);
  if (colorActivation > ColorActivation.None) throw new FormatError(`colour activation ${colorActivation} is unknown`);
  if (residualActivation > ResidualActivation.Softplus) throw new FormatError(`residual activation ${residualActivation} is unknown`);
  if (bandMask & ~0b1110) throw new FormatError(`the mask of bands, ${bandMask}, has bits outside degrees 1 to 3`);
  const isSh = id === SPHERICAL_HARMONICS;
  const [baseScale, baseOffset] = c.floats(2, 'range of the base colour');
  const shScales = (isSh ? [...c.floats(3, 'scales of spherical harmonics')] : [0, 0, 0]) as Vector;
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

  const scene: Scene = {
    count, textureHeight, model, featureDim, colorActivation, residualActivation, bandMask, neurons, hiddenLayers,
    degree: isSh ? contiguousDegree(bandMask) : bandMask ? 31 - Math.clz32(bandMask) : 0,
    antialiased: flag(0), constantInput: !flag(1), foldedFirstLayer: flag(2), exponentialBase: flag(5),
    baseScale, baseOffset, shScales, center, up, distance, testCameras, photometric,
    weights: new Uint16Array(), geometry: new Uint32Array(), payload: [], appearance: model.name, background: [0, 0, 0],
  };
  readWeights(c, scene);
  const texels = TEXTURE_WIDTH * textureHeight;
  scene.geometry = c.words(4 * texels, `geometry of ${count} Gaussians`);
  scene.payload = payloadShape(scene).map(({ words, layers }) => ({ words, layers, data: c.words(words * layers * texels, `appearance of ${count} Gaussians`) }));
  return { ...scene, ...readTrailer(c) };
}

function readWeights(c: Cursor, scene: Scene): void {
  const texels = c.word('number of weight texels');
  let expected = 0;
  if (scene.model.id === NEURAL) {
    const { neurons, hiddenLayers } = scene;
    if (neurons < 4 || neurons > MOST_NEURONS || neurons % 4 || hiddenLayers < 1 || hiddenLayers > MOST_LAYERS)
      throw new FormatError(`a network of ${hiddenLayers} layers of ${neurons} neurons is none that this format knows`);
    expected = (storedInputs(scene) / 4) * neurons + (hiddenLayers - 1) * (neurons / 4) * neurons + (neurons / 4) * 3;
  }
  if (texels !== expected) throw new FormatError(`the file has ${texels} texels of weights, its network ${expected}`);
  scene.weights = c.halves(4 * texels, 'weights');
}

/** What follows the geometry: consecutive textures of one kind as one block. */
function payloadShape(scene: Scene): { words: 2 | 4; layers: number }[] {
  if (scene.model.id === SPHERICAL_HARMONICS) {
    // Three colours of 2l+1 coefficients: 63 bits of degree 1, 120 of degree 2, 126 of degree 3.
    const shape: { words: 2 | 4; layers: number }[] = [];
    if (scene.degree >= 1) shape.push({ words: 2, layers: 1 });
    if (scene.degree >= 2) shape.push({ words: 4, layers: scene.degree - 1 });
    return shape;
  }
  const halves = scene.model.id === NEURAL ? (scene.foldedFirstLayer ? scene.neurons : scene.featureDim) : scene.featureDim * (scene.model.halvesPerUnit ?? 0);
  if (halves > MOST_HALVES) throw new FormatError(`${halves} numbers per Gaussian are more than ${MOST_HALVES}`);
  return halves ? [{ words: 4, layers: Math.ceil(halves / 8) }] : [];
}

/** Dequantisation factors of spherical harmonics, by degree. */
export function shFactors(scales: Vector): Vector {
  return scales.map((s, i) => s / (2 ** (SH_BITS[i] - 1) - 1)) as Vector;
}
