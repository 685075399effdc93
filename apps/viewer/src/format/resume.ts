// SPDX-License-Identifier: Apache-2.0
// A transfer whose connection breaks goes on where it stopped, if the server sends ranges.

import { partsOf, type Parts } from './parts';

/**
 * Times that a transfer is taken up again without having got on, and milliseconds before the first of them; each waits
 * twice as long.
 */
const TRIES = 4;
const WAIT = 500;

/**
 * Returns the header that ties the rest to the same file: the server's ETag or date. A file of gsapp needs none, because
 * the checksum at its end tells; other files without one are not resumed.
 */
function mark(url: string, headers: Headers): { 'if-range'?: string } | undefined {
  const etag = headers.get('etag');
  const validator = etag?.startsWith('"') ? etag : headers.get('last-modified');
  if (validator) return { 'if-range': validator };
  return new URL(url, location.href).pathname.endsWith('.ngsplat') ? {} : undefined;
}

/** Waits, but no longer than until `signal` aborts. */
function wait(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(resolve, milliseconds);
    signal.addEventListener(
      'abort',
      () => {
        clearTimeout(timer);
        reject(signal.reason as Error);
      },
      { once: true },
    );
  });
}

/**
 * The body of an answer to `url`, of `size` bytes where that is known. Fails as the transfer does where it cannot go
 * on.
 */
export function resumed(
  url: string,
  first: Response,
  size: number | undefined,
  signal: AbortSignal,
  pause = WAIT,
): Parts {
  const same = mark(url, first.headers);
  if (!first.body || !same || size === undefined || first.headers.get('accept-ranges') !== 'bytes')
    return partsOf(first.body!);
  let parts = partsOf(first.body);
  let at = 0;
  let tries = 0;

  /** Returns whether the rest comes now. */
  const goOn = async (): Promise<boolean> => {
    const response = await fetch(url, { signal, headers: { range: `bytes=${at}-`, ...same } }).catch(() => undefined);
    signal.throwIfAborted();
    if (!response) return false; // still no connection
    if (response.status === 429 || response.status >= 500) {
      // the server is just starting, or has too much to do
      await response.body?.cancel();
      return false;
    }
    if (
      response.status !== 206 ||
      response.headers.get('content-range') !== `bytes ${at}-${size - 1}/${size}` ||
      !response.body
    ) {
      await response.body?.cancel();
      throw new Error(
        `the connection broke, and the server ${response.status === 200 ? 'has another file by now' : 'does not go on where it stopped'}`,
      );
    }
    parts = partsOf(response.body);
    return true;
  };

  return {
    async read() {
      for (;;) {
        try {
          const part = await parts.read();
          at += part?.length ?? 0;
          tries = 0;
          return part;
        } catch (error) {
          signal.throwIfAborted();
          do {
            if (tries === TRIES) throw error;
            await wait(pause * 2 ** tries++, signal);
          } while (!(await goOn()));
        }
      }
    },
    cancel: () => parts.cancel(),
  };
}
