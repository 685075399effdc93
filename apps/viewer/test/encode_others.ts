// SPDX-License-Identifier: Apache-2.0
// Writes small .ply, .splat and .spz files for tests, independently of the readers, and decodes packed geometry.

import { gzipSync } from 'node:zlib';
import { halfToFloat } from '../src/format/half';
import type { Scene } from '../src/format/ngsplat';

/** A Gaussian as a .ply file has it: logarithms, logit, and coefficients by channel. */
export interface Gaussian {
  mean: number[];
  logScale: number[];
  /** w, x, y, z. */
  rotation: number[];
  logit: number;
  dc: number[];
  /** Of each coefficient red, green, blue. */
  rest: number[][];
}

/** Gaussians that are all different, of so many coefficients; numbers are those of single precision. */
export function someGaussians(count: number, degree: number): Gaussian[] {
  const wave = (i: number, k: number) => Math.fround(Math.sin(12.9 * i + 78.2 * k + 1));
  return Array.from({ length: count }, (_, i) => ({
    mean: [0, 1, 2].map((k) => Math.fround(3 * wave(i, k))),
    logScale: [3, 4, 5].map((k) => Math.fround(-4 + 2 * wave(i, k))),
    rotation: [6, 7, 8, 9].map((k) => Math.fround(2 * wave(i, k))),
    logit: Math.fround(4 * wave(i, 10)),
    dc: [11, 12, 13].map((k) => Math.fround(1.5 * wave(i, k))),
    rest: Array.from({ length: degree * (degree + 2) }, (_, j) =>
      [0, 1, 2].map((c) => Math.fround(0.4 * wave(i, 14 + 3 * j + c))),
    ),
  }));
}

/** Columns by name, in the order of 3DGS. */
export function columnsOf(gaussians: Gaussian[]): Record<string, number[]> {
  const columns: Record<string, number[]> = {};
  const terms = gaussians[0]?.rest.length ?? 0;
  const add = (name: string, value: (g: Gaussian) => number) => (columns[name] = gaussians.map(value));
  ['x', 'y', 'z'].forEach((name, k) => add(name, (g) => g.mean[k]));
  ['nx', 'ny', 'nz'].forEach((name) => add(name, () => 0));
  for (let k = 0; k < 3; ++k) add(`f_dc_${k}`, (g) => g.dc[k]);
  for (let c = 0; c < 3; ++c) for (let j = 0; j < terms; ++j) add(`f_rest_${c * terms + j}`, (g) => g.rest[j][c]);
  add('opacity', (g) => g.logit);
  for (let k = 0; k < 3; ++k) add(`scale_${k}`, (g) => g.logScale[k]);
  for (let k = 0; k < 4; ++k) add(`rot_${k}`, (g) => g.rotation[k]);
  return columns;
}

const SETTERS: Record<string, [number, (view: DataView, at: number, value: number, little: boolean) => void]> = {
  uchar: [1, (view, at, value) => view.setUint8(at, value)],
  short: [2, (view, at, value, little) => view.setInt16(at, value, little)],
  int: [4, (view, at, value, little) => view.setInt32(at, value, little)],
  float: [4, (view, at, value, little) => view.setFloat32(at, value, little)],
  double: [8, (view, at, value, little) => view.setFloat64(at, value, little)],
};

export interface PlyOptions {
  /** Of columns that are no float. */
  types?: Record<string, string>;
  comments?: string[];
  bigEndian?: boolean;
  lineEnd?: string;
  /** Instead of what the columns have. */
  count?: number;
  /** Lines and bytes of an element in front of the vertices. */
  before?: { lines: string[]; bytes: Uint8Array };
}

export function encodePly(columns: Record<string, number[]>, options: PlyOptions = {}): ArrayBuffer {
  const names = Object.keys(columns);
  const count = columns[names[0]]?.length ?? 0;
  const typeOf = (name: string) => options.types?.[name] ?? 'float';
  const header = [
    'ply',
    `format ${options.bigEndian ? 'binary_big_endian' : 'binary_little_endian'} 1.0`,
    ...(options.comments ?? []).map((text) => `comment ${text}`),
    ...(options.before?.lines ?? []),
    `element vertex ${options.count ?? count}`,
    ...names.map((name) => `property ${typeOf(name)} ${name}`),
    'end_header',
    '',
  ].join(options.lineEnd ?? '\n');
  const text = new TextEncoder().encode(header);
  const before = options.before?.bytes ?? new Uint8Array();
  const stride = names.reduce((sum, name) => sum + SETTERS[typeOf(name)][0], 0);
  const bytes = new Uint8Array(text.length + before.length + stride * count);
  const view = new DataView(bytes.buffer);
  bytes.set(text);
  bytes.set(before, text.length);
  let at = text.length + before.length;
  for (let i = 0; i < count; ++i) {
    for (const name of names) {
      const [size, set] = SETTERS[typeOf(name)];
      set(view, at, columns[name][i], !options.bigEndian);
      at += size;
    }
  }
  return bytes.buffer;
}

const byte = (x: number): number => Math.min(Math.max(Math.round(x), 0), 255);
export const sigmoid = (x: number): number => 1 / (1 + Math.exp(-x));
const unit = (q: number[]): number[] => q.map((x) => x / Math.hypot(...q));
const Y0 = 0.28209479177387814;

export function encodeSplat(gaussians: Gaussian[]): ArrayBuffer {
  const bytes = new Uint8Array(32 * gaussians.length);
  const view = new DataView(bytes.buffer);
  gaussians.forEach((g, i) => {
    [...g.mean, ...g.logScale.map(Math.exp)].forEach((value, k) => view.setFloat32(32 * i + 4 * k, value, true));
    bytes.set(
      [
        ...g.dc.map((dc) => byte(255 * (0.5 + Y0 * dc))),
        byte(255 * sigmoid(g.logit)),
        ...unit(g.rotation).map((x) => byte(128 * x + 128)),
      ],
      32 * i + 24,
    );
  });
  return bytes.buffer;
}

/** Whether the basis functions of degrees 1 to 3 change their sign with y and z. */
const ODD = [true, true, false, true, false, false, true, false, true, false, true, true, false, true, false];

export interface SpzOptions {
  version?: number;
  degree?: number;
  flags?: number;
  /** Instead of how many there are. */
  count?: number;
  magic?: number;
  /** What follows the Gaussians. */
  behind?: number[];
}

/** By their bits. */
const HALVES = Array.from({ length: 0x7c00 }, (_, bits) => halfToFloat(bits));

/** The bytes of the stream before gzip. */
export function spzStream(gaussians: Gaussian[], options: SpzOptions = {}): Uint8Array {
  const version = options.version ?? 3;
  const terms = gaussians[0]?.rest.length ?? 0;
  const out: number[] = [];
  const word = (w: number) => out.push(w & 255, (w >>> 8) & 255, (w >>> 16) & 255, w >>> 24);
  [options.magic ?? 0x5053474e, version, options.count ?? gaussians.length].forEach(word);
  out.push(options.degree ?? Math.sqrt(terms + 1) - 1, 12, options.flags ?? 0, 0);
  const turn = (v: number[]) => [v[0], -v[1], -v[2]];
  for (const g of gaussians)
    for (const x of turn(g.mean)) {
      if (version === 1) {
        const bits =
          HALVES.reduce(
            (best, value, b) => (Math.abs(value - Math.abs(x)) < Math.abs(HALVES[best] - Math.abs(x)) ? b : best),
            0,
          ) | (x < 0 ? 0x8000 : 0);
        out.push(bits & 255, bits >> 8);
      } else {
        const fixed = Math.round(4096 * x);
        out.push(fixed & 255, (fixed >> 8) & 255, (fixed >> 16) & 255);
      }
    }
  for (const g of gaussians) out.push(byte(255 * sigmoid(g.logit)));
  for (const g of gaussians) for (const dc of g.dc) out.push(byte(255 * (0.15 * dc + 0.5)));
  for (const g of gaussians) for (const s of g.logScale) out.push(byte(16 * (s + 10)));
  for (const g of gaussians) {
    const [w, x, y, z] = unit(g.rotation);
    const q = [w, -z, y, -x]; // as x, y, z, w after half a turn about x
    if (version < 3) {
      for (const value of q.slice(0, 3)) out.push(byte(127.5 * value * Math.sign(q[3]) + 127.5));
      continue;
    }
    const largest = q.reduce((best, value, k) => (Math.abs(value) > Math.abs(q[best]) ? k : best), 0);
    let packed = largest;
    q.forEach((value, k) => {
      if (k !== largest)
        packed =
          packed * 1024 +
          (value * q[largest] < 0 ? 512 : 0) +
          Math.min(511, Math.floor(511 * Math.abs(value) * Math.SQRT2 + 0.5));
    });
    word(packed);
  }
  for (const g of gaussians)
    g.rest.forEach((rgb, j) => rgb.forEach((value) => out.push(byte(128 * (ODD[j] ? -value : value) + 128))));
  return Uint8Array.from([...out, ...(options.behind ?? [])]);
}

export function encodeSpz(gaussians: Gaussian[], options: SpzOptions = {}): ArrayBuffer {
  const packed = gzipSync(spzStream(gaussians, options));
  return packed.buffer.slice(packed.byteOffset, packed.byteOffset + packed.byteLength) as ArrayBuffer;
}

/** A zstd frame of blocks that are not compressed. */
export function zstdFrame(bytes: Uint8Array): Uint8Array {
  const out = [0x28, 0xb5, 0x2f, 0xfd, 0xa0, ...new Uint8Array(Uint32Array.of(bytes.length).buffer)];
  const most = 1 << 16;
  for (let at = 0; at === 0 || at < bytes.length; at += most) {
    const block = bytes.subarray(at, at + most);
    const header = (block.length << 3) | Number(at + most >= bytes.length);
    out.push(header & 255, (header >> 8) & 255, header >> 16, ...block);
  }
  return Uint8Array.from(out);
}

/** Version 4, with `extensions` between header and table. */
export function encodeSpz4(gaussians: Gaussian[], extensions: number[] = []): ArrayBuffer {
  const plain = spzStream(gaussians);
  const count = gaussians.length;
  const sizes = [9, 1, 3, 3, 4, 3 * (gaussians[0]?.rest.length ?? 0)].filter((size) => size > 0);
  let end = 16;
  const streams = sizes.map((size) => zstdFrame(plain.subarray(end, (end += count * size))));
  const header = new Uint8Array(32);
  const table = new BigUint64Array(streams.flatMap((stream, k) => [BigInt(stream.length), BigInt(count * sizes[k])]));
  header.set(plain.subarray(0, 16));
  header[4] = 4;
  header[14] = extensions.length > 0 ? 2 : 0;
  header[15] = streams.length;
  new DataView(header.buffer).setUint32(16, 32 + extensions.length, true);
  return Uint8Array.from([
    ...header,
    ...extensions,
    ...new Uint8Array(table.buffer),
    ...streams.flatMap((stream) => [...stream]),
  ]).buffer;
}

/** Of a rotation and standard deviations: xx, xy, xz, yy, yz, zz. */
export function covariance(q: number[], size: number[]): number[] {
  const [w, x, y, z] = unit(q);
  const rows = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
  const entry = (i: number, j: number) => size.reduce((sum, s, k) => sum + rows[i][k] * rows[j][k] * s * s, 0);
  return [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)];
}

/** What docs/formats.md says of a Gaussian's geometry and coefficients. */
export function decoded(
  scene: Scene,
  i: number,
): { mean: number[]; size: number[]; rotation: number[]; opacity: number; base: number[]; rest: number[][] } {
  const words = scene.geometry.subarray(4 * i, 4 * i + 4);
  const byteOf = (word: number, k: number) => (words[word] >>> (8 * k)) & 255;
  let [u, v] = [2, 3].map((k) => (byteOf(2, k) / 255) * 2 - 1);
  const z = 1 - Math.abs(u) - Math.abs(v);
  if (z < 0) [u, v] = [(1 - Math.abs(v)) * (u < 0 ? -1 : 1), (1 - Math.abs(u)) * (v < 0 ? -1 : 1)];
  const angle = (byteOf(3, 3) / 255) * Math.PI;
  const norm = Math.hypot(u, v, z);
  const coefficients: number[] = [];
  const bits = [7, 8, 6];
  const places = scene.payload.flatMap(({ words: wide, layers, data }) =>
    Array.from({ length: layers }, (_, layer) =>
      data.subarray((layer * data.length) / layers + wide * i, (layer * data.length) / layers + wide * (i + 1)),
    ),
  );
  places.forEach((place, band) => {
    const number = place.reduceRight((sum, w) => (sum << 32n) | BigInt(w), 0n);
    const n = BigInt(bits[band]);
    for (let f = 0; f < 3 * (2 * band + 3); ++f)
      coefficients.push(
        (Number(BigInt.asIntN(bits[band], number >> (n * BigInt(f)))) * scene.floats[band]) /
          (2 ** (bits[band] - 1) - 1),
      );
  });
  return {
    mean: [words[1] & 0xffff, words[1] >>> 16, words[2] & 0xffff].map(halfToFloat),
    size: [0, 1, 2].map((k) => (byteOf(3, k) === 0 ? 0 : Math.exp(-12 + ((byteOf(3, k) - 1) * 21) / 254))),
    rotation: [Math.cos(angle / 2), ...[u, v, z].map((x) => (x / norm) * Math.sin(angle / 2))],
    opacity: byteOf(0, 3) / 255,
    base: [0, 1, 2].map((k) => byteOf(0, k) * scene.baseScale + scene.baseOffset),
    rest: Array.from({ length: coefficients.length / 3 }, (_, j) => coefficients.slice(3 * j, 3 * j + 3)),
  };
}
