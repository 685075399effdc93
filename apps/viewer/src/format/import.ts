// SPDX-License-Identifier: Apache-2.0
// Reads a file of any format that the viewer knows: by what it begins with, and where that says nothing, by its name.

import { FormatError } from './cursor';
import type { GaussianSource } from './gaussian_source';
import { readPly } from './import_ply';
import { readSplat } from './import_splat';
import { readSpz } from './import_spz';
import { packScene, type Imported } from './scene_packer';

/** Formats that another program makes readable. */
const CONVERTED = ['sog', 'ksplat', 'lcc', 'lcc2'];
const SOG_FOLDER = 'meta.json';

const extensionOf = (name: string): string => /\.([^./]+)$/.exec(name)?.[1].toLowerCase() ?? '';

const begins = (buffer: ArrayBuffer, text: string): boolean =>
  buffer.byteLength >= text.length && String.fromCharCode(...new Uint8Array(buffer, 0, text.length)) === text;

/** Whether it is an .ngsplat file, perhaps a damaged one: those are called so, and begin as no other format does. */
export function isNgsplat(name: string, buffer: ArrayBuffer): boolean {
  return (
    begins(buffer, 'NGSPLAT\n') ||
    (extensionOf(name) === 'ngsplat' && !['ply\n', 'ply\r', '\x1f\x8b', 'NGSP'].some((magic) => begins(buffer, magic)))
  );
}

/** `file` is what people call it; `input` stands in the command that converts it. */
function convert(file: string, input: string): FormatError {
  return new FormatError(
    `the viewer does not read ${file}; this command makes a file that it reads: npx @playcanvas/splat-transform ${input} out.ply`,
  );
}

const convertEnding = (extension: string): FormatError => convert(`.${extension} files`, `in.${extension}`);

async function readSource(name: string, buffer: ArrayBuffer): Promise<GaussianSource> {
  const extension = extensionOf(name);
  if (begins(buffer, 'ply\n') || begins(buffer, 'ply\r')) return readPly(buffer);
  if (begins(buffer, '\x1f\x8b') || begins(buffer, 'NGSP')) return readSpz(buffer, begins(buffer, '\x1f\x8b'));
  if (CONVERTED.includes(extension)) throw convertEnding(extension);
  if (name.toLowerCase() === SOG_FOLDER) throw convert('folders of SOG', SOG_FOLDER);
  if (extension === 'splat') return readSplat(buffer);
  if (begins(buffer, 'PK\x03\x04')) throw convertEnding('sog');
  throw new FormatError(
    'the viewer reads .ngsplat, .ply, .splat and .spz files; this is none of them, or it is damaged',
  );
}

/** Reads what is no .ngsplat file. Throws FormatError, which says what is wrong. */
export async function importScene(name: string, buffer: ArrayBuffer): Promise<Imported> {
  return packScene(await readSource(name, buffer));
}
