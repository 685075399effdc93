// SPDX-License-Identifier: Apache-2.0
// The blocks of an .spz file, one for each kind of number: versions 1 to 3 are one gzip stream, version 4 has a zstd
// stream for each block.

import { decompress as decompressZstd } from 'fzstd';
import { Cursor, FormatError } from './cursor';
import { allocate, restWidth } from './gaussian_source';

const MAGIC = 0x5053474e;
const HEADER_BYTES = 16;
const LONG_HEADER_BYTES = 32;
/** Bit of the flags: extensions follow, which the viewer passes over. */
const EXTENDED = 2;
/** Degrees that the format knows. */
const MOST_FILE_DEGREE = 4;
/** Deflate packs no more than this into a byte, and zstd no more into a block's header. */
const MOST_INFLATION = 1032;
const MOST_ZSTD_INFLATION = 1 << 16;

export interface SpzHeader {
  version: number;
  count: number;
  degree: number;
  fractionalBits: number;
  flags: number;
}

/** Positions, opacities, colours, scales, rotations and coefficients, each of all Gaussians. */
export interface SpzFile {
  header: SpzHeader;
  blocks: Uint8Array[];
}

/** Bytes of a Gaussian in each block. */
function blockBytes({ version, degree }: SpzHeader): number[] {
  return [version === 1 ? 6 : 9, 1, 3, 3, version >= 3 ? 4 : 3, restWidth(degree)];
}

function readHeader(c: Cursor): SpzHeader {
  if (c.word('header') !== MAGIC)
    throw new FormatError('it is compressed with gzip, but what is inside does not begin as .spz does');
  const [version, count] = [c.word('header'), c.word('header')];
  const [degree, fractionalBits, flags] = c.bytes(3, 'header');
  if (version < 1 || version > 4)
    throw new FormatError(`it is of version ${version}; the viewer reads versions 1 to 4`);
  if (degree > MOST_FILE_DEGREE)
    throw new FormatError(`its spherical harmonics have degree ${degree}, expected at most ${MOST_FILE_DEGREE}`);
  if (fractionalBits > 23) throw new FormatError(`its positions have ${fractionalBits} fractional bits, of 24 in all`);
  return { version, count, degree, fractionalBits, flags };
}

/** Throws FormatError where so few bytes cannot be `bytes` compressed. */
function requireHeld(header: SpzHeader, bytes: number, compressed: number, inflation: number): void {
  const what = `${header.count} Gaussians take ${bytes} bytes, more than ${compressed} can hold compressed`;
  if (bytes > inflation * compressed) throw new FormatError(`the file is truncated: ${what}`);
}

/** Versions 1 to 3. What may follow as extensions is left out. */
export async function readGzipBlocks(buffer: ArrayBuffer): Promise<SpzFile> {
  const reader = new Blob([buffer]).stream().pipeThrough(new DecompressionStream('gzip')).getReader();
  const begin = new Uint8Array(HEADER_BYTES);
  let length = 0;
  let header: SpzHeader | undefined;
  let bytes: Uint8Array | undefined;
  try {
    for (;;) {
      const { done, value } = await reader.read().catch(() => {
        throw new FormatError('its gzip stream is truncated or damaged');
      });
      if (done) break;
      let part = value;
      if (!header) {
        const missing = part.subarray(0, HEADER_BYTES - length);
        begin.set(missing, length);
        length += missing.length;
        part = part.subarray(missing.length);
        if (length < HEADER_BYTES) continue;
        header = readHeader(new Cursor(begin.buffer));
        if (header.version > 3)
          throw new FormatError(`it is of version ${header.version}, but compressed with gzip as versions 1 to 3 are`);
        const size = header.count * blockBytes(header).reduce((sum, n) => sum + n, 0);
        requireHeld(header, size, buffer.byteLength, MOST_INFLATION);
        bytes = allocate(Uint8Array, size);
        length = 0;
      }
      const room = bytes!.length - length;
      if (part.length > room && !(header.flags & EXTENDED))
        throw new FormatError(`more follows than the ${header.count} Gaussians of its header`);
      bytes!.set(part.subarray(0, room), length);
      length += Math.min(part.length, room);
    }
  } finally {
    await reader.cancel().catch(() => undefined);
  }
  if (!header || !bytes) throw new FormatError('the file is truncated: its header is not complete');
  if (length < bytes.length)
    throw new FormatError(
      `the file is truncated: ${header.count} Gaussians take ${bytes.length} bytes, but only ${length} follow`,
    );
  const { count } = header;
  const whole = bytes;
  let end = 0;
  return { header, blocks: blockBytes(header).map((size) => whole.subarray(end, (end += count * size))) };
}

/**
 * Version 4: a header, extensions, a table of the streams' lengths, and the streams. Those without bytes are not there.
 */
export function readZstdBlocks(buffer: ArrayBuffer): SpzFile {
  const c = new Cursor(buffer);
  const header = readHeader(c);
  if (header.version !== 4)
    throw new FormatError(`it is of version ${header.version}, but not compressed with gzip as versions 1 to 3 are`);
  const [numStreams] = c.bytes(1, 'header');
  const table = c.word('header');
  const sizes = blockBytes(header).filter((size) => size > 0);
  if (numStreams !== sizes.length)
    throw new FormatError(`it has ${numStreams} streams, expected ${sizes.length} for degree ${header.degree}`);
  if (table < LONG_HEADER_BYTES)
    throw new FormatError(`its table of streams begins at byte ${table}, inside of the header`);
  c.offset = 0;
  c.bytes(table, 'header and extensions');
  const entries = c.bytes(16 * numStreams, 'table of streams');
  const view = new DataView(entries.buffer, entries.byteOffset, entries.byteLength);
  const blocks = sizes.map((size, k) => {
    const compressed = Number(view.getBigUint64(16 * k, true));
    const bytes = Number(view.getBigUint64(16 * k + 8, true));
    if (bytes !== header.count * size)
      throw new FormatError(
        `stream ${k} has ${bytes} bytes, but ${header.count} Gaussians take ${header.count * size}`,
      );
    requireHeld(header, bytes, compressed, MOST_ZSTD_INFLATION);
    return unpack(c.bytes(compressed, `stream ${k}`), bytes);
  });
  return { header, blocks: [...blocks, new Uint8Array()].slice(0, 6) };
}

/** Throws FormatError where a zstd stream does not hold this many bytes. */
function unpack(stream: Uint8Array, bytes: number): Uint8Array {
  const out = allocate(Uint8Array, bytes);
  let length: number;
  try {
    length = decompressZstd(stream, out).length;
  } catch {
    length = -1; // its own errors, and those of writing beyond the end
  }
  if (length !== bytes) throw new FormatError('one of its zstd streams is damaged');
  return out;
}
