// SPDX-License-Identifier: Apache-2.0
// Damaged and hostile files: each is either read to a scene that can be drawn, or refused with a FormatError. The
// mutations depend on a seed alone, so that a failure names the one that did it.
import { describe, expect, it } from 'vitest';
import { camFromWorld } from '../src/camera/view';
import { crc32 } from '../src/format/crc32';
import { FormatError } from '../src/format/cursor';
import { halfToFloat } from '../src/format/half';
import type { Scene } from '../src/format/ngsplat';
import { parseScene, SceneCollector, SceneReader } from '../src/format/reader';
import { colorMix, gain } from '../src/render/photometric';
import { CAMERA, encode, type Fields } from './encode';
import { random } from './random';

const texels = (words: number, layers: number) =>
  new Uint32Array(2048 * words * layers).map((_, i) => (i * 2654435761) & 0x3bff3bff); // all halves are finite
const SEEDS: Partial<Fields>[] = [
  {},
  { count: 0 },
  { trailer: undefined },
  {
    model: 1,
    bandMask: 0b1110,
    payload: texels(10, 1),
    photometric: Array.from({ length: 18 + 9 + 9 }, (_, i) => i / 10),
  },
  { model: 2, featureDim: 2, payload: texels(4, 2) },
  { model: 3, featureDim: 1, payload: texels(4, 2), testCameras: [CAMERA, CAMERA, CAMERA] },
  { model: 4, featureDim: 1, payload: texels(4, 2) },
  { model: 3, featureDim: 1, numResiduals: 2, payload: texels(4, 2) },
  { model: 3, featureDim: 1, numResiduals: 2, flags: 512, payload: texels(4, 2) },
  {
    model: 0,
    featureDim: 16,
    bandMask: 0b1110,
    neurons: 16,
    hiddenLayers: 1,
    flags: 4,
    weights: new Uint16Array(16 * (16 + 3)).fill(0x3c00),
    payload: texels(4, 2),
  },
];
const files = SEEDS.map(
  (fields) =>
    new Uint8Array(
      encode({
        ...fields,
        trailer:
          'trailer' in fields
            ? undefined
            : { appearance: 'sh', background: [0, 0, 1], scene: 'é', test_views: { psnr: 30, packed_psnr: 29 } },
      }),
    ),
);

const HOSTILE_WORDS = [
  0, 1, 2047, 2048, 2049, 0x7fffffff, 0x80000000, 0xffffffff, 0xfffffffc, 0x10000000, 0x7fc00000, 0x7f800000,
  0xff800000, 0x7f7fffff, 0x00000001, 0x7c007c00, 0x7e00fe00,
];
const HOSTILE_JSON = [
  '',
  '{',
  'null',
  '[]',
  '7',
  '"text"',
  '{}',
  '{"appearance":"sh"}',
  '{"appearance":"sh","background":[1,2,1e999]}',
  '{"appearance":"sh","background":[0,0,1e300]}',
  '{"appearance":"sh","background":null}',
  '{"appearance":"sh","background":[0,0,0],"test_views":7,"scene":{}}',
  '{"__proto__":{"appearance":"sh"}}',
  '['.repeat(20000),
  '\xff\xfe',
];

/** What replaces the JSON of a trailer, with the length that belongs to it. */
function withJson(file: Uint8Array<ArrayBuffer>, json: string): Uint8Array<ArrayBuffer> {
  const at = new TextDecoder('latin1').decode(file).lastIndexOf('GSAPPEXT');
  if (at < 0) return file;
  const text = Uint8Array.from(json, (c) => c.charCodeAt(0));
  const out = new Uint8Array(at + 16 + text.length + 4);
  out.set(file.subarray(0, at + 12));
  new DataView(out.buffer).setUint32(at + 12, text.length, true);
  out.set(text, at + 16);
  return out;
}

/** `length` bytes from `at` on are there twice. */
function withRepeated(bytes: Uint8Array<ArrayBuffer>, at: number, length: number): Uint8Array<ArrayBuffer> {
  const end = Math.min(at + length, bytes.length);
  const out = new Uint8Array(bytes.length + end - at);
  out.set(bytes.subarray(0, end));
  out.set(bytes.subarray(at), end);
  return out;
}

function mutated(file: Uint8Array<ArrayBuffer>, next: () => number): Uint8Array<ArrayBuffer> {
  let bytes = file.slice();
  const pick = <T>(list: readonly T[]): T => list[Math.floor(next() * list.length)];
  // Most bytes are texels, of which one is as good as another: header and trailer get most of the changes.
  const anywhere = () =>
    Math.floor(
      next() < 0.3
        ? next() * bytes.length
        : next() < 0.7
          ? next() * Math.min(bytes.length, 400)
          : Math.max(0, bytes.length - 200 * next()),
    );
  const setWord = (at: number, word: number) =>
    at + 4 <= bytes.length && new DataView(bytes.buffer).setUint32(at, word, true);
  for (let changes = 1 + Math.floor(next() * 3); changes > 0 && bytes.length > 0; --changes) {
    const kind = Math.floor(next() * 8);
    const at = anywhere();
    if (kind === 0) bytes = bytes.slice(0, at);
    else if (kind === 1) bytes[at] ^= 1 << Math.floor(next() * 8);
    else if (kind <= 4) setWord(at & ~3, pick(HOSTILE_WORDS));
    else if (kind === 5) bytes[at] = Math.floor(next() * 256);
    else if (kind === 6) bytes = withJson(bytes, pick(HOSTILE_JSON));
    else bytes = withRepeated(bytes, at, 4 * Math.ceil(next() * 4));
  }
  // Behind a checksum that is wrong nothing is looked at.
  if (next() < 0.9 && bytes.length >= 4) setWord(bytes.length - 4, crc32(bytes.subarray(0, -4)));
  return bytes;
}

const HALF_INFINITE = 0x7c00;
const isFiniteHalves = (words: Uint32Array) =>
  words.every((w) => (w & HALF_INFINITE) !== HALF_INFINITE && ((w >>> 16) & HALF_INFINITE) !== HALF_INFINITE);
/** As the GPU has them. */
const areFinite = (values: ArrayLike<number>) => Array.from(values).every((v) => Number.isFinite(Math.fround(v)));

/** All arrays of numbers anywhere in it. */
function arraysOf(value: unknown): ArrayBufferView[] {
  if (ArrayBuffer.isView(value)) return [value];
  return typeof value === 'object' && value !== null ? Object.values(value).flatMap(arraysOf) : [];
}

/** What cannot be drawn of a scene, or undefined. */
function fault(scene: Scene, bytes: ArrayBuffer): string | undefined {
  const { count, textureHeight: rows, photometric } = scene;
  const all = 2048 * rows;
  if (!(count <= all && count > all - 2048)) return `${count} Gaussians in ${rows} rows`;
  if (scene.geometry.length !== 4 * all) return 'size of the geometry';
  for (const { words, layers, data } of scene.payload)
    if (data.length !== words * layers * all) return 'size of the payload';
  if (arraysOf(scene).some((array) => array.buffer === bytes)) return 'a view of the file';
  const means = Array.from({ length: count }, (_, i) => scene.geometry.subarray(4 * i + 1, 4 * i + 3)).flatMap(
    ([xy, z]) => [xy & 0xffff, xy >>> 16, z & 0xffff],
  );
  if (!areFinite(means.map(halfToFloat))) return 'a mean';
  if (!isFiniteHalves(new Uint32Array(scene.weights.slice().buffer))) return 'a weight';
  if (scene.model.packing.halves) {
    for (const { words, layers, data } of scene.payload)
      for (let layer = 0; layer < layers; ++layer)
        if (!isFiniteHalves(data.subarray(words * all * layer, words * (all * layer + count))))
          return 'a half of the payload';
  }
  if (!Object.values(scene.constants).every((n) => Number.isInteger(n) && n >= 0 && n < 2 ** 24)) return 'a constant';
  if (
    !areFinite([
      scene.baseScale,
      scene.baseOffset,
      255 * scene.baseScale + scene.baseOffset,
      scene.distance,
      ...scene.center,
      ...scene.up,
      ...scene.background,
      ...scene.floats,
    ])
  )
    return 'a number of the header';
  for (const view of scene.testCameras) {
    const { rotation, translation } = camFromWorld(view);
    const { fx, fy, cx, cy, width, height } = view;
    if (!areFinite([...rotation, ...translation, fx, fy, cx, cy, fx * fx, fy * fy])) return 'a test camera';
    if (!(Number.isInteger(width) && Number.isInteger(height) && width * height >= 1 && width * height <= 2 ** 32))
      return 'the size of a test camera';
  }
  for (const exposure of photometric ? [photometric.neutral, ...photometric.testViews] : [])
    if (!areFinite([gain(exposure[0]), ...colorMix(exposure.subarray(1)), ...photometric!.response]))
      return 'an exposure';
  if (photometric && photometric.testViews.length !== scene.testCameras.length) return 'the number of exposures';
  return undefined;
}

/**
 * As a stream brings it, in parts of up to `longest` bytes, whose memory is used again; the size is not known
 * beforehand.
 */
function parseInParts(file: ArrayBuffer, longest: number, next: () => number): Scene {
  const bytes = new Uint8Array(file);
  const part = new Uint8Array(longest);
  const reader = new SceneReader(new SceneCollector());
  for (let at = 0; at < bytes.length;) {
    const length = Math.min(1 + Math.floor(next() * longest), bytes.length - at);
    part.set(bytes.subarray(at, at + length));
    reader.push(part.subarray(0, length));
    part.fill(0xff);
    at += length;
  }
  return reader.finish();
}

function outcome(bytes: ArrayBuffer, parse = parseScene): string {
  try {
    return fault(parse(bytes), bytes) ?? 'read';
  } catch (error) {
    if (!(error instanceof FormatError)) return `${(error as Error).name}: ${(error as Error).message}`;
    return error.message.length > 10 && error.message.length < 300 ? 'refused' : `the message '${error.message}'`;
  }
}

describe('parseScene of damaged files', () => {
  it('reads the files that the damaged ones are made of', () => {
    for (const file of files) expect(outcome(file.buffer)).toBe('read');
  });

  it('reads or refuses each, and nothing else', { timeout: 60_000 }, () => {
    const seen = { read: 0, refused: 0 };
    const faults: string[] = [];
    for (let seed = 0; seed < 6000; ++seed) {
      const next = random(seed);
      const bytes = mutated(files[seed % files.length], next);
      const found = outcome(bytes.buffer);
      if (found === 'read' || found === 'refused') ++seen[found];
      else faults.push(`seed ${seed}: ${found}`);
    }
    expect(faults).toEqual([]);
    expect(Math.min(seen.read, seen.refused)).toBeGreaterThan(500); // else the mutations would be of no use
  });

  it('reads or refuses the same in parts of any size', () => {
    const seen: Record<string, number> = {};
    const faults: string[] = [];
    for (let seed = 0; seed < 3000; ++seed) {
      const next = random(seed);
      const { buffer } = mutated(files[seed % files.length], next);
      const whole = outcome(buffer);
      const parts = outcome(buffer, (file) => parseInParts(file, [300, 5000, 50_000][seed % 3], next));
      if (whole !== parts || !['read', 'refused'].includes(parts))
        faults.push(`seed ${seed}: ${whole}, in parts ${parts}`);
      seen[parts] = (seen[parts] ?? 0) + 1;
    }
    expect(faults).toEqual([]);
    expect(Math.min(seen.read, seen.refused)).toBeGreaterThan(250);
  });

  it('refuses every truncation', () => {
    const file = files[5];
    for (let length = 0; length < file.length; length += length < 600 || length > file.length - 100 ? 1 : 997)
      expect(outcome(file.slice(0, length).buffer), `${length} bytes`).toMatch(
        length + 100 < file.length ? 'refused' : /read|refused/,
      );
  });
});
