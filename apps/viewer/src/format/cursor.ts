// SPDX-License-Identifier: Apache-2.0
// A position in a file's bytes that refuses to pass their end.

/** The file is not what it should be; the message is for the user. */
export class FormatError extends Error {}

/** What to say of an error. Browsers have words of their own for an array that finds no memory. */
export const messageOf = (error: unknown): string =>
  error instanceof RangeError ? 'The memory does not suffice for this file.' : (error as Error).message;

/** The bytes end too early. */
export class Truncated extends FormatError {
  /** `end`: how many bytes there would have to be at least; there are `length`. */
  constructor(
    what: string,
    bytes: number,
    at: number,
    readonly end: number,
    length: number,
  ) {
    super(`the file is truncated: ${what} would take ${bytes} bytes at byte ${at}, but it ends after ${length - at}`);
  }
}

/** Far beyond all that means something; single precision ends at 3e38. */
export const LARGEST_NUMBER = 1e15;

export class Cursor {
  offset = 0;

  /**
   * `buffer` holds little-endian numbers, of which arrays lie at multiples of their size, as .ngsplat has them. It
   * begins at byte `start` of the file. What is read is copied.
   */
  constructor(
    private readonly buffer: ArrayBuffer,
    private readonly start = 0,
  ) {}

  get rest(): number {
    return this.buffer.byteLength - this.offset;
  }

  require(bytes: number, what: string): void {
    if (bytes > this.rest)
      throw new Truncated(
        what,
        bytes,
        this.start + this.offset,
        this.start + this.offset + bytes,
        this.start + this.buffer.byteLength,
      );
  }

  private take(bytes: number, what: string): number {
    this.require(bytes, what);
    const at = this.offset;
    this.offset += bytes;
    return at;
  }

  bytes(length: number, what: string): Uint8Array {
    return new Uint8Array(this.buffer, this.take(length, what), length).slice();
  }
  text(length: number, what: string): string {
    return String.fromCharCode(...this.bytes(length, what));
  }
  words(count: number, what: string): Uint32Array {
    return new Uint32Array(this.buffer, this.take(4 * count, what), count).slice();
  }
  word(what: string): number {
    return new DataView(this.buffer).getUint32(this.take(4, what), true);
  }
  halves(count: number, what: string): Uint16Array {
    return new Uint16Array(this.buffer, this.take(2 * count, what), count).slice();
  }
  /**
   * Throws where one is not finite, or so large that arithmetic on the GPU would lose it: nothing in a header may be.
   */
  floats(count: number, what: string): Float32Array {
    const values = new Float32Array(this.buffer, this.take(4 * count, what), count).slice();
    const bad = values.find((value) => !(Math.abs(value) <= LARGEST_NUMBER));
    if (bad !== undefined)
      throw new FormatError(`${what}: a value is ${bad}, not a finite number up to ${LARGEST_NUMBER}`);
    return values;
  }
}
