// SPDX-License-Identifier: Apache-2.0
// The header of a .ply file: which numbers its binary part has, and where.

import { FormatError } from './cursor';

type Read = (view: DataView, at: number, littleEndian: boolean) => number;

const TYPES: Record<string, { bytes: number; read: Read }> = {
  char: { bytes: 1, read: (view, at) => view.getInt8(at) },
  uchar: { bytes: 1, read: (view, at) => view.getUint8(at) },
  short: { bytes: 2, read: (view, at, little) => view.getInt16(at, little) },
  ushort: { bytes: 2, read: (view, at, little) => view.getUint16(at, little) },
  int: { bytes: 4, read: (view, at, little) => view.getInt32(at, little) },
  uint: { bytes: 4, read: (view, at, little) => view.getUint32(at, little) },
  float: { bytes: 4, read: (view, at, little) => view.getFloat32(at, little) },
  double: { bytes: 8, read: (view, at, little) => view.getFloat64(at, little) },
};
const SIZED = ['int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'float32', 'float64'];
Object.values(TYPES).forEach((type, k) => (TYPES[SIZED[k]] = type));

export interface PlyProperty {
  type: string;
  /** Bytes from the beginning of the row. */
  offset: number;
  read: Read;
}
export interface PlyElement {
  name: string;
  count: number;
  /** Bytes of a row. */
  stride: number;
  /** Whether a property is a list, so that rows differ in length. */
  hasLists: boolean;
  properties: Map<string, PlyProperty>;
}
export interface PlyHeader {
  littleEndian: boolean;
  comments: string[];
  elements: PlyElement[];
  /** Bytes of the header. */
  bytes: number;
}

/** No file that means something has a longer header, or more elements or properties. */
const MOST_BYTES = 1 << 20;
const MOST_ENTRIES = 4096;
const END = 'end_header';

const misplaced = (line: string, expected: string): FormatError =>
  new FormatError(`its header has a line '${line.slice(0, 80)}', which is no ${expected}`);

/** Throws FormatError where the header is none, or is of a kind that the viewer does not read. */
export function readPlyHeader(buffer: ArrayBuffer): PlyHeader {
  const text = new TextDecoder('latin1').decode(new Uint8Array(buffer, 0, Math.min(buffer.byteLength, MOST_BYTES)));
  const end = /^end_header(\r?\n|\r(?!\n))/m.exec(text);
  if (!end) throw new FormatError(`its header has no line ${END}: the file is truncated, or no .ply`);
  const header: PlyHeader = { littleEndian: true, comments: [], elements: [], bytes: end.index + end[0].length };
  let format = '';
  let entries = 0;
  for (const line of text.slice(0, end.index).split(/\r\n|\r|\n/)) {
    const [keyword, ...words] = line.trim().split(/\s+/);
    const element = header.elements.at(-1);
    if (keyword === 'format') format = words[0] ?? '';
    else if (keyword === 'comment') header.comments.push(words.join(' '));
    else if (keyword === 'element') {
      const [name, count] = words;
      if (name === undefined || !/^\d{1,15}$/.test(count ?? '')) throw misplaced(line, 'element with a count');
      header.elements.push({ name, count: Number(count), stride: 0, hasLists: false, properties: new Map() });
    } else if (keyword === 'property') {
      const [type, name] = words;
      const known = Object.hasOwn(TYPES, type ?? '') ? TYPES[type] : undefined;
      if (!element || words.length < 2 || (!known && type !== 'list')) throw misplaced(line, 'property of an element');
      if (!known) element.hasLists = true;
      else if (element.properties.has(name))
        throw new FormatError(`its header has the property ${name.slice(0, 80)} twice`);
      else {
        element.properties.set(name, { type, offset: element.stride, read: known.read });
        element.stride += known.bytes;
      }
    } else continue; // 'ply', obj_info, empty lines
    if (++entries > MOST_ENTRIES) throw new FormatError(`its header has more than ${MOST_ENTRIES} lines`);
  }
  if (format === 'ascii')
    throw new FormatError(
      'its numbers are text (format ascii); the viewer reads binary .ply files, as which most programs can save it',
    );
  if (format !== 'binary_little_endian' && format !== 'binary_big_endian')
    throw new FormatError(`its format '${format.slice(0, 80)}' is unknown`);
  header.littleEndian = format === 'binary_little_endian';
  return header;
}
