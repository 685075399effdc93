// SPDX-License-Identifier: Apache-2.0
// CRC-32 as in zlib and PNG (reflected polynomial 0xedb88320).

// Sixteen tables of 256, behind one another: table k holds the effect of a byte that is k bytes further from the end,
// so that sixteen bytes are taken at once.
const tables = new Int32Array(16 * 256);
for (let i = 0; i < tables.length; ++i) {
  if (i < 256) {
    let c = i;
    for (let bit = 0; bit < 8; ++bit) c = c & 1 ? (c >>> 1) ^ 0xedb88320 : c >>> 1;
    tables[i] = c;
  } else {
    const nearer = tables[i - 256];
    tables[i] = (nearer >>> 8) ^ tables[nearer & 255];
  }
}

/** CRC-32 of `bytes`, or of what came before with `bytes` appended. */
export function crc32(bytes: Uint8Array, before = 0): number {
  let c = ~before;
  let i = 0;
  for (const aligned = Math.min(bytes.length, -bytes.byteOffset & 3); i < aligned; ++i)
    c = (c >>> 8) ^ tables[(c ^ bytes[i]) & 255];
  const blocks = (bytes.length - i) >>> 4;
  // little endian
  const words = blocks ? new Int32Array(bytes.buffer, bytes.byteOffset + i, 4 * blocks) : new Int32Array();
  for (let k = 0; k < words.length; k += 4) {
    const w = words[k] ^ c;
    const x = words[k + 1];
    const y = words[k + 2];
    const z = words[k + 3];
    c =
      tables[0xf00 | (w & 255)] ^
      tables[0xe00 | ((w >>> 8) & 255)] ^
      tables[0xd00 | ((w >>> 16) & 255)] ^
      tables[0xc00 | (w >>> 24)] ^
      tables[0xb00 | (x & 255)] ^
      tables[0xa00 | ((x >>> 8) & 255)] ^
      tables[0x900 | ((x >>> 16) & 255)] ^
      tables[0x800 | (x >>> 24)] ^
      tables[0x700 | (y & 255)] ^
      tables[0x600 | ((y >>> 8) & 255)] ^
      tables[0x500 | ((y >>> 16) & 255)] ^
      tables[0x400 | (y >>> 24)] ^
      tables[0x300 | (z & 255)] ^
      tables[0x200 | ((z >>> 8) & 255)] ^
      tables[0x100 | ((z >>> 16) & 255)] ^
      tables[z >>> 24];
  }
  for (i += 4 * words.length; i < bytes.length; ++i) c = (c >>> 8) ^ tables[(c ^ bytes[i]) & 255];
  return ~c >>> 0;
}
