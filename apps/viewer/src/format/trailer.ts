// SPDX-License-Identifier: Apache-2.0
// What gsapp adds behind the last texture: JSON, and a checksum of all that comes before it. Files of others end there.

import { crc32 } from './crc32';
import { Cursor, FormatError, LARGEST_NUMBER } from './cursor';
import type { Vector } from './vector';

const MAGIC = 'GSAPPEXT';
const VERSION = 1;

/** The file's coordinates are x = scale (X - center) of the scene's own X. */
export interface Frame {
  center: Vector;
  scale: number;
}

export interface Trailer {
  appearance: string;
  background: Vector;
  /** Name of the scene. */
  name?: string;
  /** Undefined: the file has the scene's own coordinates. */
  frame?: Frame;
  /** The means of the test views, in decibels: of the model, and of what the file keeps of it. */
  psnr?: { model: number; packed: number };
  /** Whether a site.json lies beside the file. */
  hasSite?: boolean;
  /** Whether its cameras are those of a training that left none out for a test. */
  areTrainingViews?: boolean;
}

interface Json {
  appearance: string;
  background: Vector;
  scene: string;
  frame: Partial<Frame>;
  test_views: { psnr: number; packed_psnr: number };
  site: boolean;
  views: string;
}

/**
 * Undefined where the file ends without one. `bytes`: all that is behind the last texture, from byte `start` of the
 * file on; `before`: the checksum of all in front of it. Throws FormatError where something else follows, or the
 * checksum is another one.
 */
export function readTrailer(bytes: Uint8Array<ArrayBuffer>, start: number, before: number): Trailer | undefined {
  const behind = bytes.length;
  if (behind === 0) return undefined;
  const c = new Cursor(bytes.slice().buffer, start);
  if (behind < MAGIC.length || c.text(MAGIC.length, 'trailer') !== MAGIC)
    throw new FormatError(`${behind} unknown bytes follow the last texture`);
  const version = c.word('trailer');
  if (version !== VERSION)
    throw new FormatError(
      `its trailer is of version ${version}, this viewer reads ${VERSION}: a newer gsapp wrote the file`,
    );
  const json = c.bytes(c.word('trailer'), 'trailer');
  const computed = crc32(bytes.subarray(0, c.offset), before);
  const stored = c.word('checksum');
  if (computed !== stored)
    throw new FormatError(`its checksum is ${hex(computed)}, not ${hex(stored)}: the file is damaged`);
  if (c.rest > 0) throw new FormatError(`${c.rest} bytes follow the checksum`);
  let content: Partial<Json> | null;
  try {
    content = JSON.parse(new TextDecoder().decode(json)) as Partial<Json> | null;
  } catch (error) {
    throw new FormatError(`its trailer is not JSON: ${(error as Error).message}`);
  }
  return fromJson(content ?? {});
}

const hex = (n: number): string => n.toString(16).padStart(8, '0');

function checkedFrame({ center, scale }: Partial<Frame>): Frame {
  if (
    !Array.isArray(center) ||
    center.length !== 3 ||
    !center.every(Number.isFinite) ||
    !(Number.isFinite(scale) && scale! > 0)
  )
    throw new FormatError('the frame in its trailer is none');
  return { center, scale: scale! };
}

function fromJson({ appearance, background, scene, frame, test_views: scores, site, views }: Partial<Json>): Trailer {
  if (
    typeof appearance !== 'string' ||
    !Array.isArray(background) ||
    background.length !== 3 ||
    !background.every((value) => Number.isFinite(value) && Math.abs(value) <= LARGEST_NUMBER)
  )
    throw new FormatError('its trailer lacks appearance or background, or a colour of the background is no number');
  return {
    appearance,
    background,
    name: typeof scene === 'string' ? scene : undefined,
    frame: frame ? checkedFrame(frame) : undefined,
    hasSite: site === true,
    areTrainingViews: views === 'training',
    psnr:
      scores && Number.isFinite(scores.psnr) && Number.isFinite(scores.packed_psnr)
        ? { model: scores.psnr, packed: scores.packed_psnr }
        : undefined,
  };
}
