// SPDX-License-Identifier: Apache-2.0
// Prints what sorting (for WebGL2; with WebGPU the device sorts), the checksum and loading cost: npm run bench. Times
// are the least of several, as other programs may run.

import type { View } from '../src/camera/view';
import { crc32 } from '../src/format/crc32';
import { readParts } from '../src/format/load';
import { TEXTURE_WIDTH } from '../src/format/ngsplat';
import { partsOf } from '../src/format/parts';
import { SceneReader } from '../src/format/reader';
import { DepthSorter } from '../src/sort/sort';

const REPEATS = 9;
const MILLION = 1_000_000;
const MEGABYTE = 1e6;

/** Numbers in [0,1) that are the same every time. */
function random(seed: number): () => number {
  let s = seed;
  return () => ((s = (Math.imul(s, 1664525) + 1013904223) >>> 0), s / 2 ** 32);
}

function toHalf(value: number): number {
  const bits = new Uint32Array(Float32Array.of(value).buffer)[0];
  const exponent = ((bits >>> 23) & 255) - 112;
  return ((bits >>> 16) & 0x8000) | (exponent <= 0 ? 0 : (exponent << 10) | ((bits >>> 13) & 0x3ff));
}

/** Packed geometry of a ball's shell and of what is around it, in the order of small cells as training leaves it. */
function shell(count: number): Uint32Array {
  const r = random(5);
  const cells = 64;
  const keys = new Float64Array(count);
  const points = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    const p = [r() - 0.5, r() - 0.5, r() - 0.5];
    const length = Math.hypot(...p);
    const radius = 1 + 0.2 * r() + (r() < 0.1 ? 3 * r() : 0);
    p.forEach((x, k) => (points[3 * i + k] = (x / length) * radius));
    const cell = [0, 1, 2].reduce((sum, k) => cells * sum + Math.floor(((points[3 * i + k] + 4.3) / 8.6) * cells), 0);
    keys[i] = cell * 2 ** 24 + i;
  }
  keys.sort();
  const texels = new Uint32Array(4 * count);
  for (let i = 0; i < count; ++i) {
    const [x, y, z] = points.subarray(3 * (keys[i] % 2 ** 24), 3 * (keys[i] % 2 ** 24) + 3);
    texels.set([0xff000000, toHalf(x) | (toHalf(y) << 16), toHalf(z), 0x808080 >> 1], 4 * i);
  }
  return texels;
}

function best(work: () => void): number {
  let least = Infinity;
  for (let i = 0; i < REPEATS; ++i) {
    const begin = performance.now();
    work();
    least = Math.min(least, performance.now() - begin);
  }
  return least;
}

const OUTSIDE: View = {
  right: [1, 0, 0],
  down: [0, 1, 0],
  forward: [0, 0, 1],
  position: [0, 0, -9],
  fx: 700,
  fy: 700,
  cx: 640,
  cy: 360,
  width: 1280,
  height: 720,
};
const INSIDE: View = { ...OUTSIDE, position: [0, 0, 0] };

function benchSort(): void {
  for (const millions of [1, 3, 6]) {
    const count = millions * MILLION;
    const sorter = new DepthSorter(count);
    const order = new Uint32Array(count);
    sorter.add(shell(count));
    for (const [name, view] of [
      ['from outside', OUTSIDE],
      ['from inside', INSIDE],
    ] as const) {
      let drawn = 0;
      const time = best(() => (drawn = sorter.sort(view, 1, order)));
      console.log(
        `WebGL2: sort of ${millions} M ${name}, ${(drawn / MILLION).toFixed(2)} M in the view: ${time.toFixed(1)} ms`,
      );
    }
  }
}

function benchChecksum(): void {
  const bytes = Uint8Array.from({ length: 64 << 20 }, (_, i) => Math.imul(i, 2654435761) >>> 11);
  console.log(`checksum: ${((bytes.length / MEGABYTE / best(() => crc32(bytes))) * 1000).toFixed(0)} MB/s`);
}

/** A file of model sh of degree 3 without a trailer, as a server sends it. */
function streamOf(count: number): { size: number; stream: ReadableStream<Uint8Array> } {
  const rows = Math.ceil(count / TEXTURE_WIDTH);
  const part = 1 << 16;
  const header = new Uint32Array([
    0x5053474e,
    0x0a54414c,
    count,
    TEXTURE_WIDTH,
    rows,
    0,
    0,
    0b1110,
    0,
    0,
    0,
    0,
    1 << 3,
    ...Array<number>(14).fill(0),
  ]);
  const size = header.byteLength + 56 * rows * TEXTURE_WIDTH;
  let at = 0;
  return {
    size,
    stream: new ReadableStream({
      pull: (controller) => {
        const bytes = new Uint8Array(Math.min(part, size - at));
        if (at === 0) bytes.set(new Uint8Array(header.buffer));
        at += bytes.length;
        controller.enqueue(bytes);
        if (at === size) controller.close();
      },
    }),
  };
}

/**
 * Measures the array buffers that JavaScript holds while a file is read, each time after a collection.
 */
async function benchLoading(count: number): Promise<void> {
  const collect = (globalThis as { gc?: () => void }).gc;
  if (!collect) throw new Error('run with node --expose-gc');
  const used = () => (collect(), process.memoryUsage().arrayBuffers);
  const { size, stream } = streamOf(count);
  const before = used();
  let sorter: DepthSorter | undefined;
  let peak = 0;
  let parts = 0;
  let longest = 0;
  let turn = performance.now();
  const reader = new SceneReader(
    {
      begin: (scene) => (sorter = new DepthSorter(scene.count)),
      rows: (plane, _, texels) => plane.block < 0 && sorter!.add(texels),
    },
    size,
  );
  const clock = setInterval(() => {
    longest = Math.max(longest, performance.now() - turn);
    turn = performance.now();
  }, 0);
  const begin = performance.now();
  let measuring = 0;
  await readParts({ name: 'f', size, parts: partsOf(stream) }, (part) => {
    reader.push(part);
    if (++parts % 100) return;
    const from = performance.now();
    peak = Math.max(peak, used() - before);
    measuring += performance.now() - from;
    turn += performance.now() - from;
  });
  const time = performance.now() - begin - measuring;
  clearInterval(clock);
  reader.finish();
  const kept = used() - before;
  const mib = (bytes: number) => `${(bytes / 2 ** 20).toFixed(0)} MiB, ${(bytes / size).toFixed(2)} of the file`;
  console.log(
    `loading of a file of ${(size / 2 ** 20).toFixed(0)} MiB: ${time.toFixed(0)} ms, at most ${longest.toFixed(0)} ms without a pause`,
  );
  console.log(`memory with the sorter of ${count / MILLION} M: peak ${mib(peak)}; kept ${mib(kept)}`);
}

benchSort();
benchChecksum();
for (const millions of [3, 6]) await benchLoading(millions * MILLION);
