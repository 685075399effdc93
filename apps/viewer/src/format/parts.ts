// SPDX-License-Identifier: Apache-2.0
// Bytes that come in parts, and leave no garbage where the browser can read into memory that it is given.

/** Bytes that a part has at most where it is read into memory of ours. */
const MOST_BYTES = 1 << 20;

export interface Parts {
  /** The next bytes, or undefined behind the last. They may be overwritten by the next call. */
  read(): Promise<Uint8Array | undefined>;
  /** Lets go of the rest. */
  cancel(): Promise<void>;
}

/**
 * The readers whose read has not ended. Without this set, a read and its stream know only each other, and Chromium
 * (seen in 156) collects both as garbage where the bytes are those of a file, so that the read never ends.
 */
const awaited = new Set<ReadableStreamBYOBReader>();

/** Fills the same memory again and again. */
class Refilled implements Parts {
  private memory = new ArrayBuffer(MOST_BYTES);

  constructor(private readonly reader: ReadableStreamBYOBReader) {}

  async read(): Promise<Uint8Array | undefined> {
    awaited.add(this.reader);
    const { done, value } = await this.reader
      .read(new Uint8Array(this.memory))
      .finally(() => awaited.delete(this.reader));
    if (value) this.memory = value.buffer; // the one that was passed is nobody's any more
    return done ? undefined : value;
  }

  cancel(): Promise<void> {
    return this.reader.cancel();
  }
}

/** The bytes of a stream. */
export function partsOf(stream: ReadableStream<Uint8Array>): Parts {
  let reader: ReadableStreamBYOBReader;
  try {
    reader = stream.getReader({ mode: 'byob' });
  } catch {
    // the browser does not know it, or not for this stream
    const other = stream.getReader();
    return { read: async () => (await other.read()).value, cancel: () => other.cancel() };
  }
  return new Refilled(reader);
}
