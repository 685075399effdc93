// SPDX-License-Identifier: Apache-2.0
// Damaged and hostile camera paths and descriptions of sites: each is read to something that can be shown, or refused
// with a message.
import { describe, expect, it } from 'vitest';
import { parsePath, PathError } from '../src/camera/path_files';
import { parseSite } from '../src/compare/site';
import { random } from './random';

const VIEWS = 2;
const camera = {
  id: 0,
  width: 100,
  height: 50,
  position: [1, 2, 3],
  rotation: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
  fy: 60,
  fx: 60,
  keyframe: true,
};
const PATHS = [
  [camera, { ...camera, offset: [0, 1, 0], keyframe: undefined }],
  {
    camera_type: 'perspective',
    render_height: 50,
    render_width: 100,
    fps: 30,
    seconds: 4,
    camera_path: [
      { camera_to_world: [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1], fov: 45, aspect: 2, keyframe: true },
    ],
  },
];
const first = { file: 'scene.ngsplat', name: 'a' };
const SITES = [
  { version: 1, models: [first, { file: 'scene-2.ngsplat', name: 'b' }], photographs: ['photographs/00000.png', null] },
  {
    version: 1,
    models: [first],
    levels: [
      { file: 'scene.ngsplat', num_gaussians: 9, bytes: 90, psnr: 30 },
      { file: 'a.ngsplat', num_gaussians: 4, bytes: 40 },
    ],
  },
];
const HOSTILE: unknown[] = [
  null,
  true,
  0,
  -1,
  0.5,
  1e9,
  1e300,
  -1e300,
  '',
  'a',
  '../a.ngsplat',
  'https://example.com/a.ngsplat',
  'a.ngsplat',
  'scene.ngsplat',
  [],
  {},
  [null],
  [[]],
  { length: 3 },
  [1, 2, 3],
];

/** Replaces, removes or repeats something anywhere in it. */
function alter(json: unknown, next: () => number): unknown {
  const pick = <T>(list: readonly T[]): T => list[Math.floor(next() * list.length)];
  if (typeof json !== 'object' || json === null || next() < 0.05) return pick(HOSTILE);
  const copy = (Array.isArray(json) ? [...(json as unknown[])] : { ...json }) as Record<string, unknown>;
  const key = pick(Object.keys(json));
  if (key === undefined) return pick(HOSTILE);
  const kind = next();
  if (kind < 0.1) delete copy[key];
  else if (kind < 0.2) copy[pick(Object.keys(json))] = copy[key];
  else if (kind < 0.3 && Array.isArray(copy)) copy.push(copy[key as unknown as number]);
  else copy[key] = alter(copy[key], next);
  return copy;
}

function mutated(seeds: readonly unknown[], seed: number): string {
  const next = random(seed);
  let json = seeds[seed % seeds.length];
  for (let changes = 1 + Math.floor(next() * 2); changes > 0; --changes) json = alter(json, next);
  const text = JSON.stringify(json) ?? '';
  const at = Math.floor(next() * text.length);
  const kind = next();
  // Numbers that JSON can hold and JavaScript cannot, and text that is no JSON.
  if (kind < 0.1) return text.replace(/\d+/, '1e999');
  return kind < 0.2
    ? text.slice(0, at)
    : kind < 0.3
      ? text.slice(0, at) + pickCharacter(next) + text.slice(at + 1)
      : text;
}

const pickCharacter = (next: () => number): string => String.fromCharCode(32 + Math.floor(next() * 95));

/** Counts what is read and what is refused, and lists what else happens. */
function tally(
  seeds: readonly unknown[],
  parse: (text: string) => string | undefined,
): { read: number; refused: number; faults: string[] } {
  const seen = { read: 0, refused: 0, faults: [] as string[] };
  for (let seed = 0; seed < 6000; ++seed) {
    const text = mutated(seeds, seed);
    try {
      const fault = parse(text);
      if (fault === undefined) ++seen.read;
      else seen.faults.push(`seed ${seed}: ${fault}`);
    } catch (error) {
      if (error instanceof PathError || (error as Error).constructor === Error) ++seen.refused;
      else seen.faults.push(`seed ${seed}: ${(error as Error).name}: ${(error as Error).message}`);
    }
  }
  return seen;
}

function faultOfPath(text: string): string | undefined {
  const { keyframes, seconds } = parsePath(text);
  if (keyframes.length === 0) return 'no keyframes';
  if (seconds !== undefined && !(seconds > 0 && seconds < Infinity)) return `${seconds} seconds`;
  for (const { position, right, down, forward, fx, fy, cx, cy, width, height } of keyframes) {
    if (![...position, ...right, ...down, ...forward, cx, cy].every(Number.isFinite))
      return 'a number that is not finite';
    if (!(fx > 0 && fy > 0 && fx < Infinity && fy < Infinity)) return `focal lengths ${fx} and ${fy}`;
    if (!(Number.isInteger(width) && Number.isInteger(height) && Math.min(width, height) > 0))
      return `a picture of ${width} x ${height}`;
  }
  return undefined;
}

function faultOfSite(text: string): string | undefined {
  const {
    name,
    other,
    levels = [{ file: 'scene.ngsplat', count: 1, bytes: 1 }],
    photographs = [undefined, undefined],
  } = parseSite(text, VIEWS);
  if (typeof name !== 'string' || typeof (other?.name ?? '') !== 'string') return 'a name that is no text';
  const files = [other?.file, ...levels.map(({ file }) => file), ...photographs].filter((file) => file !== undefined);
  if (files.some((file) => !/^\w[\w./-]*\.(ngsplat|png|jpe?g)$/.test(file) || file.includes('..')))
    return `files ${files.join()}`;
  if (levels.length === 0 || levels.some(({ count, bytes, psnr = 0 }) => ![count, bytes, psnr].every(Number.isFinite)))
    return 'a level without numbers';
  return photographs.length === VIEWS ? undefined : `${photographs.length} photographs`;
}

describe.each([
  ['parsePath', PATHS, faultOfPath],
  ['parseSite', SITES, faultOfSite],
] as const)('%s of damaged text', (_, seeds, fault) => {
  it('reads what the damaged text is made of', () => {
    for (const json of seeds) expect(fault(JSON.stringify(json))).toBeUndefined();
  });

  it('reads or refuses each, and nothing else', () => {
    const { read, refused, faults } = tally(seeds, fault);
    expect(faults).toEqual([]);
    expect(Math.min(read, refused)).toBeGreaterThan(300); // else the mutations would be of no use
  });
});
