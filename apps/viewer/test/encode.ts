// SPDX-License-Identifier: Apache-2.0
// Writes small .ngsplat files for tests, independently of gsapp.

export interface Fields {
  count: number;
  featureDim: number;
  bandMask: number;
  colorActivation: number;
  residualActivation: number;
  neurons: number;
  hiddenLayers: number;
  flags: number;
  /** Gaussians with a residual; all, if undefined. */
  numResiduals?: number;
  model: number;
  weights: Uint16Array;
  /** x, y, z of each Gaussian as half-precision bits. */
  positions: number[][];
  testCameras: number[][];
  photometric: number[];
  payload: Uint32Array;
  trailer: unknown;
}

export const CAMERA = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -3, 100, 100, 32, 32, 64, 64];
export const TRAILER = { appearance: 'sh', background: [1, 0.5, 0] };

/** The bytes of a file; without any fields, of three Gaussians of model `none`. */
export function encode(fields: Partial<Fields> = {}): ArrayBuffer {
  const f: Fields = {
    count: 3,
    featureDim: 0,
    bandMask: 0,
    colorActivation: 0,
    residualActivation: 0,
    neurons: 0,
    hiddenLayers: 0,
    flags: 0,
    model: 1,
    weights: new Uint16Array(),
    positions: [[0x3c00, 0xc100, 0x0000]],
    testCameras: [CAMERA],
    photometric: [],
    payload: new Uint32Array(),
    trailer: TRAILER,
    ...fields,
  };
  const rows = Math.ceil(f.count / 2048);
  const flags =
    f.flags |
    ((f.model & 3) << 3) |
    ((f.model & 4) << 4) |
    (f.photometric.length ? 1 << 7 : 0) |
    (f.numResiduals === undefined ? 0 : 1 << 8);
  const parts: ArrayBufferView[] = [];
  const text = (s: string) => parts.push(new TextEncoder().encode(s));
  const words = (...w: number[]) => parts.push(new Uint32Array(w));
  const floats = (...w: number[]) => parts.push(new Float32Array(w));
  text('NGSPLAT\n');
  words(
    f.count,
    2048,
    rows,
    f.featureDim,
    0,
    f.bandMask,
    f.colorActivation,
    f.residualActivation,
    f.neurons,
    f.hiddenLayers,
    flags,
  );
  if (f.numResiduals !== undefined) words(f.numResiduals);
  floats(0.01, -0.5);
  if (f.model === 1) floats(6.3, 12.7, 3.1);
  floats(0, 0, 0, 0, -1, 0, 3);
  words(f.testCameras.length);
  for (const camera of f.testCameras) floats(...camera);
  floats(...f.photometric);
  words(f.weights.length / 4);
  parts.push(f.weights);
  const geometry = new Uint32Array(4 * 2048 * rows);
  for (let i = 0; i < f.count; ++i) {
    const [x, y, z] = f.positions[i % f.positions.length];
    geometry.set([0xff000000 | (i & 0xff), x | (y << 16), z, 0], 4 * i);
  }
  parts.push(geometry, f.payload);
  if (f.trailer !== undefined) {
    const json = new TextEncoder().encode(JSON.stringify(f.trailer));
    text('GSAPPEXT');
    words(1, json.length);
    parts.push(json);
  }
  const bytes = concatenate(parts);
  return f.trailer === undefined ? bytes.buffer : concatenate([bytes, new Uint32Array([crc(bytes)])]).buffer;
}

function concatenate(parts: ArrayBufferView[]): Uint8Array<ArrayBuffer> {
  const bytes = new Uint8Array(parts.reduce((sum, p) => sum + p.byteLength, 0));
  let at = 0;
  for (const p of parts) {
    bytes.set(new Uint8Array(p.buffer, p.byteOffset, p.byteLength), at);
    at += p.byteLength;
  }
  return bytes;
}

/** Bit by bit, as the polynomial is defined. */
export function crc(bytes: Uint8Array): number {
  let c = 0xffffffff;
  for (const byte of bytes) {
    c ^= byte;
    for (let bit = 0; bit < 8; ++bit) c = c & 1 ? (c >>> 1) ^ 0xedb88320 : c >>> 1;
  }
  return ~c >>> 0;
}

/** The bits of the nearest half-precision number; 0 below the normal ones. */
export function toHalf(value: number): number {
  const bits = new Uint32Array(Float32Array.of(value).buffer)[0];
  const sign = (bits >>> 16) & 0x8000;
  const rounded = ((bits & 0x7fffffff) + 0x1000) >>> 13;
  const exponent = (rounded >> 10) - 112;
  return exponent <= 0 ? sign : sign | (exponent << 10) | (rounded & 0x3ff);
}
