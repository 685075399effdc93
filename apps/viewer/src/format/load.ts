// SPDX-License-Identifier: Apache-2.0
// The bytes of a file that comes in parts.

import { FormatError } from './cursor';
import type { Parts } from './parts';
import { resumed } from './resume';

/** Bytes that tell formats apart. */
const HEAD = 16;

export interface Source {
  name: string;
  /** Bytes, as far as known beforehand. */
  size?: number;
  parts: Parts;
}

/** The last part of an address, to show. Throws Error where it is none. */
function nameOf(url: string): string {
  let name: string;
  try {
    name = new URL(url, location.href).pathname.split('/').pop() || url;
  } catch {
    throw new Error(`'${url}' is no address of a file`);
  }
  try {
    return decodeURIComponent(name);
  } catch {
    return name; // a '%' that begins no byte of UTF-8
  }
}

/** `signal` aborts the transfer. Throws Error with a message for the user. */
export async function fetchSource(url: string, signal: AbortSignal): Promise<Source> {
  const name = nameOf(url);
  let response: Response;
  try {
    response = await fetch(url, { signal });
  } catch (error) {
    if (signal.aborted) throw error;
    throw new Error(
      `${name} cannot be fetched. Another site must allow this with CORS headers; from a folder on disk, start a web server (gsapp view does).`,
    );
  }
  if (!response.ok || !response.body)
    throw new Error(`${name} cannot be fetched: the server answers ${response.status} ${response.statusText}`);
  // Compressed on the way, the length is another one.
  const length = response.headers.has('content-encoding') ? NaN : Number(response.headers.get('content-length') ?? NaN);
  const size = Number.isSafeInteger(length) && length >= 0 ? length : undefined;
  return { name, size, parts: resumed(url, response, size, signal) };
}

/**
 * Longest stretch of work in milliseconds before the page may do something else, and the bytes that are worked on at
 * once.
 */
const LONGEST_WORK = 16;
const PART = 1 << 20;

/** Resolves as soon as the page has done what waits; not only after a while, as timers do in a tab behind others. */
function pause(): Promise<void> {
  return new Promise((resolve) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resolve();
    };
    port2.postMessage(undefined);
  });
}

/** Does all of `steps`, but no longer than LONGEST_WORK without a pause. Throws what they throw. */
export async function inSteps<T>(steps: Iterable<T>, work: (step: T) => void): Promise<void> {
  let begin = performance.now();
  for (const step of steps) {
    work(step);
    if (performance.now() - begin < LONGEST_WORK) continue;
    await pause();
    begin = performance.now();
  }
}

function* cut(bytes: Uint8Array): Generator<Uint8Array> {
  for (let at = 0; at < bytes.length; at += PART) yield bytes.subarray(at, at + PART);
}

/** Passes all bytes to `take` as they arrive. Throws what it throws, and then lets go of the transfer. */
export async function readParts(source: Source, take: (part: Uint8Array) => void): Promise<void> {
  let begin = performance.now();
  try {
    for (let part; (part = await source.parts.read());) {
      await inSteps(cut(part), take);
      if (performance.now() - begin < LONGEST_WORK) continue; // parts that are there already come without a pause
      await pause();
      begin = performance.now();
    }
  } finally {
    await source.parts.cancel().catch(() => undefined); // so that an abandoned transfer ends
  }
}

/** The bytes that tell formats apart, and a source of all of them. */
export async function peekHead(source: Source): Promise<{ head: ArrayBuffer; source: Source }> {
  const { parts } = source;
  const read: Uint8Array[] = [];
  let head = new Uint8Array();
  while (head.length < HEAD) {
    const part = await parts.read();
    if (!part) break;
    read.push(part.slice()); // before the next one overwrites it
    const longer = new Uint8Array(head.length + Math.min(part.length, HEAD));
    longer.set(head);
    longer.set(part.subarray(0, HEAD), head.length);
    head = longer;
  }
  const again: Parts = { read: async () => read.shift() ?? parts.read(), cancel: () => parts.cancel() };
  return { head: head.buffer, source: { ...source, parts: again } };
}

/** The whole file. `progress` gets the bytes so far. Throws FormatError where memory does not suffice. */
export async function readAll(source: Source, progress: (bytes: number) => void): Promise<ArrayBuffer> {
  const allocate = (size: number) => {
    try {
      return new Uint8Array(size);
    } catch {
      throw new FormatError(`this browser cannot give ${size} bytes of memory for the file`);
    }
  };
  let bytes = allocate(source.size ?? 1 << 20);
  let length = 0;
  await readParts(source, (part) => {
    if (length + part.length > bytes.length) {
      const larger = allocate(Math.max(2 * bytes.length, length + part.length));
      larger.set(bytes.subarray(0, length));
      bytes = larger;
    }
    bytes.set(part, length);
    length += part.length;
    progress(length);
  });
  return length === bytes.length ? bytes.buffer : bytes.buffer.slice(0, length);
}
