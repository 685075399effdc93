// SPDX-License-Identifier: Apache-2.0
// Damaged and hostile .ply, .splat and .spz files: each becomes a scene that can be drawn, or is refused with a
// FormatError, in bounded time and memory. The mutations depend on a seed alone, so that a failure names the one that
// did it.
import { readFileSync } from 'node:fs';
import { gunzipSync, gzipSync } from 'node:zlib';
import { describe, expect, it } from 'vitest';
import { FormatError } from '../src/format/cursor';
import { halfToFloat } from '../src/format/half';
import { importScene } from '../src/format/import';
import type { Scene } from '../src/format/ngsplat';
import { columnsOf, encodePly, encodeSplat, encodeSpz, encodeSpz4, someGaussians } from './encode_others';

interface Seed {
  name: string;
  file: Uint8Array<ArrayBuffer>;
  /** Whether the file is changed before it is compressed. */
  packed?: boolean;
}

const seed = (name: string, buffer: ArrayBuffer, packed = false): Seed => ({
  name,
  file: packed ? new Uint8Array(gunzipSync(new Uint8Array(buffer))) : new Uint8Array(buffer),
  packed,
});
const bytesOfFile = (name: string): ArrayBuffer =>
  Uint8Array.from(readFileSync(new URL(`data/${name}`, import.meta.url))).buffer;
const POINTS = { x: [0, 1, 2], y: [0, 1, 0], z: [1, 1, 2], red: [0, 255, 51], green: [255, 0, 0], blue: [0, 0, 255] };
const SEEDS: Seed[] = [
  seed('a.ply', encodePly(columnsOf(someGaussians(5, 3)))),
  seed(
    'a.ply',
    encodePly(columnsOf(someGaussians(3, 0)), {
      types: { x: 'double', opacity: 'double' },
      bigEndian: true,
      comments: ['SplatRenderMode: mip', 'gsapp appearance sh max_degree 0 active_degree 0 activation relu'],
    }),
  ),
  seed('a.ply', encodePly(POINTS, { types: { red: 'uchar', green: 'uchar', blue: 'uchar' } })),
  seed('a.splat', encodeSplat(someGaussians(6, 0))),
  seed('a.spz', encodeSpz(someGaussians(4, 2))),
  seed('a.spz', encodeSpz4(someGaussians(4, 1))),
  seed('a.spz', bytesOfFile('version4.spz')), // compressed blocks
  seed('a.spz', encodeSpz(someGaussians(4, 1)), true),
  seed('a.spz', encodeSpz(someGaussians(4, 3), { version: 2 }), true),
  seed('a.spz', encodeSpz(someGaussians(4, 0), { version: 1, flags: 3, behind: [1, 2, 3, 4] }), true),
];

/** Numbers from 0 to 1 that depend on the seed (a linear congruence whose high bits are used). */
function random(state: number): () => number {
  state = Math.imul(state, 2654435761) >>> 0;
  return () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
}

const HOSTILE_WORDS = [
  0, 1, 2, 0x7fffffff, 0x80000000, 0xffffffff, 0x10000000, 0x7fc00000, 0x7f800000, 0xff800000, 0x7f7fffff, 0xff7fffff,
  0x00000001, 0x01000000, 0x0000ffff, 0x5f000000,
];
const HOSTILE_TEXT = [
  '4294967295',
  '999999999999999',
  '0',
  '-1',
  '1e9',
  'nan',
  'property float x',
  'property list uchar int v',
  'element vertex 7',
  'element other 99999999',
  'end_header',
  'property double opacity',
  'format ascii 1.0',
  '\n',
  '\r',
  '__proto__',
  'constructor',
  'property float f_rest_45',
  'property char scale_0',
  ' ',
];

function mutated({ name, file, packed }: Seed, next: () => number): { name: string; buffer: ArrayBuffer } {
  let bytes: Uint8Array<ArrayBuffer> = file.slice();
  const pick = <T>(list: readonly T[]): T => list[Math.floor(next() * list.length)];
  const join = (...parts: Uint8Array[]) => Uint8Array.from(parts.flatMap((part) => [...part]));
  for (let changes = 1 + Math.floor(next() * 3); changes > 0 && bytes.length > 0; --changes) {
    // Headers get more than their share.
    const kind = Math.floor(next() * 8);
    const at = Math.floor(
      next() < 0.5 ? next() * bytes.length : next() * Math.min(bytes.length, name === 'a.ply' ? 900 : 140),
    );
    if (kind === 0) bytes = bytes.slice(0, at);
    else if (kind === 1) bytes[at] ^= 1 << Math.floor(next() * 8);
    else if (kind === 2) bytes[at] = Math.floor(next() * 256);
    else if (kind <= 4 && at + 4 <= bytes.length) new DataView(bytes.buffer).setUint32(at, pick(HOSTILE_WORDS), true);
    else if (kind === 5)
      bytes = join(bytes.subarray(0, at), bytes.subarray(at, at + Math.ceil(next() * 80)), bytes.subarray(at));
    else if (kind === 6) bytes = join(bytes.subarray(0, at), bytes.subarray(at + Math.ceil(next() * 40)));
    else {
      // A word of the header becomes another one.
      const text = new TextDecoder('latin1').decode(bytes);
      const words = [...text.slice(0, Math.max(text.indexOf('end_header'), 0)).matchAll(/\S+/g)];
      if (words.length === 0) continue;
      const word = pick(words);
      bytes = Uint8Array.from(
        text.slice(0, word.index) + pick(HOSTILE_TEXT) + text.slice(word.index + word[0].length),
        (c) => c.charCodeAt(0),
      );
    }
  }
  if (packed) bytes = new Uint8Array(gzipSync(bytes));
  return { name, buffer: bytes.slice().buffer };
}

const isFinite32 = (value: number): boolean => Number.isFinite(Math.fround(value));

/** What cannot be drawn of a scene, or undefined. */
function fault(scene: Scene): string | undefined {
  const { count, textureHeight: rows } = scene;
  const all = 2048 * rows;
  if (!(Number.isInteger(count) && count > 0 && count <= all && count > all - 2048))
    return `${count} Gaussians in ${rows} rows`;
  if (scene.geometry.length !== 4 * all || scene.numResiduals !== count || scene.payloadHeight !== rows)
    return 'size of the geometry';
  for (const { words, layers, data } of scene.payload)
    if (data.length !== words * layers * all) return 'size of the payload';
  for (let i = 0; i < count; ++i)
    for (const bits of [
      scene.geometry[4 * i + 1] & 0xffff,
      scene.geometry[4 * i + 1] >>> 16,
      scene.geometry[4 * i + 2] & 0xffff,
    ])
      if (!Number.isFinite(halfToFloat(bits))) return `the mean of ${i}`;
  if (scene.geometry.subarray(4 * count).some((word) => word !== 0)) return 'something behind the last Gaussian';
  const { baseScale, baseOffset, distance, center, up, floats } = scene;
  if (![baseScale, baseOffset, 255 * baseScale + baseOffset, distance, ...center, ...up, ...floats].every(isFinite32))
    return 'a number of the header';
  return baseScale > 0 && distance > 0 ? undefined : 'a size that is not positive';
}

/** No file here has more than some hundred Gaussians. */
const MOST_BYTES = 1 << 20;

async function outcome(name: string, buffer: ArrayBuffer): Promise<string> {
  try {
    const { scene, remarks } = await importScene(name, buffer);
    const size = scene.geometry.byteLength + scene.payload.reduce((sum, { data }) => sum + data.byteLength, 0);
    if (size > MOST_BYTES) return `${size} bytes`;
    if (remarks.some((remark) => remark.length > 300)) return `the remark '${remarks.join(' ')}'`;
    return fault(scene) ?? 'read';
  } catch (error) {
    if (!(error instanceof FormatError)) return `${(error as Error).name}: ${(error as Error).message}`;
    return error.message.length > 10 && error.message.length < 400 ? 'refused' : `the message '${error.message}'`;
  }
}

describe('importScene of damaged files', () => {
  it('reads the files that the damaged ones are made of', async () => {
    for (const { name, file, packed } of SEEDS)
      expect(await outcome(name, packed ? new Uint8Array(gzipSync(file)).buffer : file.slice().buffer)).toBe('read');
  });

  it('reads or refuses each, and nothing else', { timeout: 60_000 }, async () => {
    const seen: Record<string, number> = {};
    const faults: string[] = [];
    for (let k = 0; k < 10_000; ++k) {
      const which = k % SEEDS.length;
      const { name, buffer } = mutated(SEEDS[which], random(k));
      const begin = performance.now();
      const found = await outcome(name, buffer);
      if (found === 'read' || found === 'refused') seen[`${which} ${found}`] = (seen[`${which} ${found}`] ?? 0) + 1;
      else faults.push(`seed ${k}: ${found}`);
      if (performance.now() - begin > 2000) faults.push(`seed ${k} takes ${performance.now() - begin} ms`);
    }
    expect(faults).toEqual([]);
    // Else the mutations would be of no use.
    expect(
      SEEDS.map((_, k) => Math.min(seen[`${k} refused`] ?? 0, k === 4 ? 100 : (seen[`${k} read`] ?? 0))).filter(
        (n) => n < 50,
      ),
    ).toEqual([]);
  });

  it('refuses every truncation', { timeout: 60_000 }, async () => {
    for (const { name, file } of SEEDS.filter(({ packed }) => !packed)) {
      for (let length = 0; length < file.length; ++length) {
        const found = await outcome(name, file.slice(0, length).buffer);
        expect(found, `${length} bytes of ${name}`).toBe(
          name === 'a.splat' && length > 0 && length % 32 === 0 ? 'read' : 'refused',
        );
      }
    }
  });
});
