// SPDX-License-Identifier: Apache-2.0
// Files beside scene.ngsplat in an exported site: site.json (docs/formats.md) names a second model and the
// photographs.

import { fetchSource, readAll } from '../format/load';
import type { Level } from '../levels/levels';

export const SITE_FILE = 'site.json';
export const FIRST_MODEL = 'scene.ngsplat';
const VERSION = 1;
/** More characters than any site needs. */
const LONGEST = 1 << 22;
const LONGEST_NAME = 200;
const MOST_LEVELS = 16;

export interface Site {
  /** What the model of scene.ngsplat is called. */
  name: string;
  other?: { file: string; name: string };
  /** All of the model and coarser ones, the finest first. */
  levels?: Level[];
  /** A path for each test view; undefined where its photograph is not there. */
  photographs?: (string | undefined)[];
}

/** Below the page alone: no other site, no folder above, nothing that an address gives a meaning to. */
function isOwnPath(path: unknown, endings: RegExp): path is string {
  return typeof path === 'string' && /^[\w-][\w.-]*(\/[\w-][\w.-]*)*$/.test(path) && endings.test(path);
}

function model(value: unknown): { file: string; name: string } {
  const { file, name } = (value ?? {}) as Record<string, unknown>;
  if (!isOwnPath(file, /\.ngsplat$/)) throw new Error(`${JSON.stringify(file)} is no .ngsplat file of this site`);
  if (typeof name !== 'string') throw new Error(`the model ${file} has no name`);
  return { file, name: name.slice(0, LONGEST_NAME) };
}

function level(value: unknown): Level {
  const { file, num_gaussians: count, bytes, psnr } = (value ?? {}) as Record<string, unknown>;
  if (!isOwnPath(file, /\.ngsplat$/)) throw new Error(`${JSON.stringify(file)} is no .ngsplat file of this site`);
  const isCount = (x: unknown): x is number => Number.isSafeInteger(x) && (x as number) >= 0;
  if (!isCount(count) || !isCount(bytes)) throw new Error(`the level ${file} lacks its Gaussians or its bytes`);
  return { file, count, bytes, psnr: Number.isFinite(psnr) ? (psnr as number) : undefined };
}

function levelsOf(list: unknown): Level[] | undefined {
  if (list === undefined) return undefined;
  if (!Array.isArray(list) || list.length < 1 || list.length > MOST_LEVELS)
    throw new Error('its levels are no list of some');
  const levels = list.map(level);
  if (levels[0].file !== FIRST_MODEL) throw new Error(`its first level is ${levels[0].file}, not ${FIRST_MODEL}`);
  if (levels.some(({ count }, k) => k > 0 && count >= levels[k - 1].count))
    throw new Error('its levels do not become coarser');
  return levels;
}

/** Throws Error, which says what is wrong, for anything but the description of a site with so many test views. */
export function parseSite(text: string, numViews: number): Site {
  let json: { version?: unknown; models?: unknown; levels?: unknown; photographs?: unknown } | null;
  try {
    json = JSON.parse(text) as typeof json;
  } catch (error) {
    throw new Error(`it is not JSON: ${(error as Error).message}`);
  }
  if (json?.version !== VERSION)
    throw new Error(`it is of version ${JSON.stringify(json?.version)}, this viewer reads ${VERSION}`);
  if (!Array.isArray(json.models) || json.models.length < 1 || json.models.length > 2)
    throw new Error('it names neither one model nor two');
  const [first, other] = json.models.map(model);
  if (first.file !== FIRST_MODEL) throw new Error(`its first model is ${first.file}, not ${FIRST_MODEL}`);
  if (other?.file === FIRST_MODEL) throw new Error('its two models are the same');
  const { photographs } = json;
  const levels = levelsOf(json.levels);
  if (photographs === undefined) return { name: first.name, other, levels };
  if (!Array.isArray(photographs) || photographs.length !== numViews)
    throw new Error(`it has no list of ${numViews} photographs, one for each test view`);
  return {
    name: first.name,
    other,
    levels,
    photographs: photographs.map((path: unknown) => {
      if (path !== null && !isOwnPath(path, /\.(png|jpe?g)$/))
        throw new Error(`${JSON.stringify(path)} is no picture of this site`);
      return path ?? undefined;
    }),
  };
}

/** Throws Error with a message for the user. */
export async function fetchSite(numViews: number): Promise<Site> {
  const source = await fetchSource(SITE_FILE, new AbortController().signal);
  const text = new TextDecoder().decode(await readAll(source, () => undefined));
  if (text.length > LONGEST) throw new Error(`it has more than ${LONGEST} characters`);
  return parseSite(text, numViews);
}
