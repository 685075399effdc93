// SPDX-License-Identifier: Apache-2.0
// What gsapp adds behind the last texture: JSON, and a checksum of all that comes before it. Files of others end there.

import { crc32 } from './crc32';
import { FormatError, type Cursor } from './cursor';
import type { Vector } from './ngsplat';

const MAGIC = 'GSAPPEXT', VERSION = 1;

export interface Trailer {
  appearance: string;
  background: Vector;
}

/** Undefined where the file ends without one. Throws FormatError where something else follows, or the checksum is another one. */
export function readTrailer(c: Cursor): Trailer | undefined {
  if (c.rest === 0) return undefined;
  const behind = c.rest;
  if (behind < MAGIC.length || c.text(MAGIC.length, 'trailer') !== MAGIC) throw new FormatError(`${behind} unknown bytes follow the last texture`);
  const version = c.word('trailer');
  if (version !== VERSION) throw new FormatError(`its trailer is of version ${version}, this viewer reads ${VERSION}: a newer gsapp wrote the file`);
  const json = c.bytes(c.word('trailer'), 'trailer');
  const computed = crc32(new Uint8Array(c.buffer, 0, c.offset)), stored = c.word('checksum');
  if (computed !== stored) throw new FormatError(`its checksum is ${hex(computed)}, not ${hex(stored)}: the file is damaged`);
  if (c.rest > 0) throw new FormatError(`${c.rest} bytes follow the checksum`);
  return checked(JSON.parse(new TextDecoder().decode(json)) as Partial<Trailer>);
}

const hex = (n: number): string => n.toString(16).padStart(8, '0');

function checked({ appearance, background }: Partial<Trailer>): Trailer {
  if (typeof appearance !== 'string' || !Array.isArray(background) || background.length !== 3 || !background.every(Number.isFinite))
    throw new FormatError('its trailer lacks appearance or background');
  return { appearance, background };
}
