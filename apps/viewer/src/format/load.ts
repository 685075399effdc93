// SPDX-License-Identifier: Apache-2.0
// The bytes of a file that comes in parts, with progress.

import { FormatError } from './cursor';

export interface Source {
  name: string;
  /** Bytes, as far as known beforehand. */
  size?: number;
  stream: ReadableStream<Uint8Array>;
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
    throw new Error(`${name} cannot be fetched. Another site must allow this with CORS headers; from a folder on disk, start a web server (gsapp view does).`);
  }
  if (!response.ok || !response.body) throw new Error(`${name} cannot be fetched: the server answers ${response.status} ${response.statusText}`);
  // Compressed on the way, the length is another one.
  const length = response.headers.has('content-encoding') ? NaN : Number(response.headers.get('content-length') ?? NaN);
  return { name, size: Number.isSafeInteger(length) && length >= 0 ? length : undefined, stream: response.body };
}

/** The whole file. `progress` gets the bytes so far. Throws FormatError where memory does not suffice. */
export async function readAll(source: Source, progress: (bytes: number) => void): Promise<ArrayBuffer> {
  let bytes: Uint8Array<ArrayBuffer>, length = 0;
  const allocate = (size: number) => {
    try {
      return new Uint8Array(size);
    } catch {
      throw new FormatError(`this browser cannot give ${size} bytes of memory for the file`);
    }
  };
  bytes = allocate(source.size ?? 1 << 20);
  const reader = source.stream.getReader();
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      if (length + value.length > bytes.length) {
        const larger = allocate(Math.max(2 * bytes.length, length + value.length));
        larger.set(bytes.subarray(0, length));
        bytes = larger;
      }
      bytes.set(value, length);
      length += value.length;
      progress(length);
    }
  } finally {
    await reader.cancel().catch(() => undefined); // so that an abandoned transfer ends
  }
  return length === bytes.length ? bytes.buffer : bytes.buffer.slice(0, length);
}
