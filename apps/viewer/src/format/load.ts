// SPDX-License-Identifier: Apache-2.0
// The bytes of a file that comes in parts.

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

/** Longest stretch of work in milliseconds before the page may do something else, and the bytes that are worked on at once. */
const LONGEST_WORK = 16, PART = 1 << 20;

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

function* partsOf(bytes: Uint8Array): Generator<Uint8Array> {
  for (let at = 0; at < bytes.length; at += PART) yield bytes.subarray(at, at + PART);
}

/** Passes all bytes to `take` as they arrive. Throws what it throws, and then lets go of the transfer. */
export async function readParts(source: Source, take: (part: Uint8Array) => void): Promise<void> {
  const reader = source.stream.getReader();
  let begin = performance.now();
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      await inSteps(partsOf(value), take);
      if (performance.now() - begin < LONGEST_WORK) continue; // parts that are there already come without a pause
      await pause();
      begin = performance.now();
    }
  } finally {
    await reader.cancel().catch(() => undefined); // so that an abandoned transfer ends
  }
}
