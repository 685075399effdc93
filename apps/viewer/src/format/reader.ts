// SPDX-License-Identifier: Apache-2.0
// Reads an .ngsplat file from parts as they arrive. No more of it is kept than the header and the part of a texture
// that is being filled: texels are checked and handed on, and the checksum is computed on the way.

import { crc32 } from './crc32';
import { Cursor, FormatError, Truncated } from './cursor';
import { areFiniteHalves, isFiniteHalf } from './half';
import { readHeader, TEXTURE_WIDTH, type Scene } from './ngsplat';
import { readTrailer } from './trailer';

/** Bytes of texels that are handed on at once: some milliseconds of work. */
const SLAB_BYTES = 1 << 20;
/** Far more than any trailer has. */
const MOST_TRAILER = 1 << 20;

/** One texture of the file: the geometry, or a layer of a block of the payload. */
export interface Plane {
  /** In Scene.payload; -1 is the geometry. */
  block: number;
  layer: number;
  /** Of a texel. */
  words: 2 | 4;
  rows: number;
  /** Gaussians that have a texel; what is behind them in the last row means nothing. */
  count: number;
  hasHalves: boolean;
}

/** Takes what a file has, in its order. */
export interface SceneSink {
  /**
   * The header is read; the scene has no texels, and appearance, background and what else the trailer has are not known
   * yet.
   */
  begin(scene: Scene): void;
  /**
   * Whole rows of a texture from `row` on, those of the geometry as soon as they are there. `texels` may be overwritten
   * after the call.
   */
  rows(plane: Plane, row: number, texels: Uint32Array): void;
}

/** The textures of a file, in its order. */
export function planesOf(scene: Scene): Plane[] {
  const geometry: Plane = {
    block: -1,
    layer: 0,
    words: 4,
    rows: scene.textureHeight,
    count: scene.count,
    hasHalves: false,
  };
  const payload = scene.payload.flatMap(({ words, layers, halfLayers }, block) =>
    Array.from({ length: layers }, (_, layer): Plane => ({
      block,
      layer,
      words,
      rows: scene.payloadHeight,
      count: scene.numResiduals,
      hasHalves: layer >= layers - halfLayers,
    })),
  );
  return [geometry, ...payload].filter((plane) => plane.rows > 0);
}

export const planeBytes = ({ words, rows }: Plane): number => 4 * words * TEXTURE_WIDTH * rows;
const rowsOfSlab = ({ words }: Plane): number => SLAB_BYTES / (4 * words * TEXTURE_WIDTH);

/** What is not finite would spread over the picture. `texels` are those of Gaussians from `first` on. */
function check(plane: Plane, first: number, texels: Uint32Array): void {
  if (plane.hasHalves) {
    if (!areFiniteHalves(texels)) throw new FormatError('the appearance of a Gaussian is not finite');
  } else if (plane.block < 0) {
    for (let i = 0; i < texels.length; i += 4) {
      const xy = texels[i + 1];
      const z = texels[i + 2];
      if (!(isFiniteHalf(xy) && isFiniteHalf(xy >>> 16) && isFiniteHalf(z)))
        throw new FormatError(`the mean of Gaussian ${first + i / 4} is not finite`);
    }
  }
}

/** What has arrived of something whose size is not known. */
class Buffer {
  private data = new Uint8Array(1 << 12);
  private length = 0;

  append(part: Uint8Array): void {
    if (this.length + part.length > this.data.length) {
      const larger = new Uint8Array(Math.max(2 * this.data.length, this.length + part.length));
      larger.set(this.bytes);
      this.data = larger;
    }
    this.data.set(part, this.length);
    this.length += part.length;
  }

  get bytes(): Uint8Array<ArrayBuffer> {
    return this.data.subarray(0, this.length);
  }
}

export class SceneReader {
  /** Bytes so far. */
  bytes = 0;
  /** Bytes of the file up to the end of its last texture, once the header is read. */
  end: number | undefined;
  private header: Buffer | undefined = new Buffer();
  /** More bytes are needed before it is worth reading the header (again). */
  private headerEnd = 8;
  private scene: Scene | undefined;
  private planes: Plane[] = [];
  private slab = new Uint32Array();
  private slabBytes = new Uint8Array();
  private filled = 0;
  /** The row of the first plane in `planes` that the slab begins with. */
  private row = 0;
  private checksum = 0;
  private readonly trailer = new Buffer();

  /** `size` is that of the whole file, as far as it is known. */
  constructor(
    private readonly sink: SceneSink,
    private readonly size?: number,
  ) {}

  /** The next bytes of the file. Throws FormatError, which says what is wrong. */
  push(part: Uint8Array): void {
    this.bytes += part.length;
    if (this.header) {
      this.header.append(part);
      if (this.bytes < this.headerEnd) return;
      part = this.takeHeader();
    }
    while (part.length > 0 && this.planes.length > 0) part = part.subarray(this.fill(part));
    if (this.planes[0]?.block === -1) this.flush(); // so that it can be shown
    if (part.length > 0) this.trailer.append(part);
    if (this.trailer.bytes.length > MOST_TRAILER)
      throw new FormatError(`more than ${MOST_TRAILER} bytes follow the last texture`);
  }

  /** Returns what is behind the header; nothing while that has not arrived. */
  private takeHeader(): Uint8Array {
    const { bytes } = this.header!;
    const c = new Cursor(bytes.slice().buffer);
    let scene: Scene;
    try {
      scene = readHeader(c);
    } catch (error) {
      if (!(error instanceof Truncated) || error.end > (this.size ?? Infinity)) throw error;
      this.headerEnd = error.end;
      return new Uint8Array();
    }
    this.planes = planesOf(scene);
    this.end = this.planes.reduce((sum, plane) => sum + planeBytes(plane), c.offset);
    // No memory is taken for what does not come.
    if (this.end > (this.size ?? Infinity)) this.failAtTexels(c.offset, this.size!);
    this.sink.begin(scene);
    this.scene = scene;
    this.checksum = crc32(bytes.subarray(0, c.offset));
    this.header = undefined;
    this.slab = new Uint32Array(Math.min(SLAB_BYTES, Math.max(0, ...this.planes.map(planeBytes))) / 4);
    this.slabBytes = new Uint8Array(this.slab.buffer);
    return bytes.subarray(c.offset);
  }

  /** Throws Truncated naming the texture in which a file of `length` bytes ends. */
  private failAtTexels(at: number, length: number): never {
    for (const plane of planesOf(this.scene ?? readHeader(new Cursor(this.header!.bytes.slice().buffer)))) {
      const bytes = planeBytes(plane);
      const what = plane.block < 0 ? `geometry of ${plane.count} Gaussians` : `appearance of ${plane.count} Gaussians`;
      if (at + bytes > length) throw new Truncated(what, bytes, at, at + bytes, length);
      at += bytes;
    }
    throw new FormatError('the file is truncated');
  }

  /** Copies what fits of the current slab, hands it on where it is full, and returns how many bytes it took. */
  private fill(part: Uint8Array): number {
    const plane = this.planes[0];
    const rowBytes = 4 * plane.words * TEXTURE_WIDTH;
    const slabEnd = rowBytes * Math.min(rowsOfSlab(plane), plane.rows - this.row);
    const taken = Math.min(part.length, slabEnd - this.filled);
    this.slabBytes.set(part.subarray(0, taken), this.filled);
    this.filled += taken;
    if (this.filled === slabEnd) this.flush();
    return taken;
  }

  /** Hands on all rows that are complete, though the slab may not be full. */
  private flush(): void {
    const plane = this.planes[0];
    const rowWords = plane.words * TEXTURE_WIDTH;
    const rows = Math.floor(this.filled / (4 * rowWords));
    if (rows === 0) return;
    const texels = this.slab.subarray(0, rows * rowWords);
    const first = TEXTURE_WIDTH * this.row;
    this.checksum = crc32(this.slabBytes.subarray(0, texels.byteLength), this.checksum);
    check(plane, first, texels.subarray(0, plane.words * Math.min(rows * TEXTURE_WIDTH, plane.count - first)));
    this.sink.rows(plane, this.row, texels);
    this.slab.copyWithin(0, texels.length, Math.ceil(this.filled / 4));
    this.filled -= texels.byteLength;
    this.row += rows;
    if (this.row === plane.rows) {
      this.planes.shift();
      this.row = 0;
    }
  }

  /**
   * No more bytes come. Returns the scene, which now has what the trailer says. Throws FormatError where they end too
   * early or too late.
   */
  finish(): Scene {
    if (this.header) {
      readHeader(new Cursor(this.header.bytes.slice().buffer)); // throws
      throw new FormatError('the file is truncated');
    }
    const scene = this.scene!;
    if (this.planes.length > 0)
      this.failAtTexels(this.end! - planesOf(scene).reduce((sum, plane) => sum + planeBytes(plane), 0), this.bytes);
    return Object.assign(scene, readTrailer(this.trailer.bytes, this.end!, this.checksum));
  }
}

function allocate(words: number): Uint32Array {
  try {
    return new Uint32Array(words);
  } catch {
    throw new FormatError(`this browser cannot give ${4 * words} bytes of memory for the file`);
  }
}

/** Keeps the texels in the scene itself. */
export class SceneCollector implements SceneSink {
  private scene!: Scene;

  begin(scene: Scene): void {
    this.scene = scene;
    scene.geometry = allocate(4 * TEXTURE_WIDTH * scene.textureHeight);
    for (const block of scene.payload)
      block.data = allocate(block.words * block.layers * TEXTURE_WIDTH * scene.payloadHeight);
  }

  rows(plane: Plane, row: number, texels: Uint32Array): void {
    const { scene } = this;
    const data = plane.block < 0 ? scene.geometry : scene.payload[plane.block].data;
    data.set(texels, plane.words * TEXTURE_WIDTH * (plane.layer * plane.rows + row));
  }
}

/**
 * The texels of a scene that has them, in parts as a file brings them. Those of a texture are let go of behind its last
 * part.
 */
export function* texelsOf(scene: Scene): Generator<[plane: Plane, row: number, texels: Uint32Array]> {
  for (const plane of planesOf(scene)) {
    const holder = plane.block < 0 ? undefined : scene.payload[plane.block];
    const rowWords = plane.words * TEXTURE_WIDTH;
    for (let row = 0; row < plane.rows; row += rowsOfSlab(plane)) {
      const at = rowWords * (plane.layer * plane.rows + row);
      const rows = Math.min(rowsOfSlab(plane), plane.rows - row);
      yield [plane, row, (holder?.data ?? scene.geometry).subarray(at, at + rows * rowWords)];
    }
    if (!holder) scene.geometry = new Uint32Array();
    else if (plane.layer === holder.layers - 1) holder.data = new Uint32Array();
  }
}

/** A file that is there as a whole. Throws FormatError, which says what is wrong. */
export function parseScene(file: ArrayBuffer): Scene {
  const reader = new SceneReader(new SceneCollector(), file.byteLength);
  reader.push(new Uint8Array(file));
  return reader.finish();
}
