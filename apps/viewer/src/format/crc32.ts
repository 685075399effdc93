// SPDX-License-Identifier: Apache-2.0
// CRC-32 as in zlib and PNG (reflected polynomial 0xedb88320).

// Eight tables: table k holds the effect of a byte that is k bytes further from the end, so that eight bytes are taken at once.
const tables: Uint32Array[] = [];
for (let k = 0; k < 8; ++k) {
  const table = new Uint32Array(256);
  for (let i = 0; i < 256; ++i) {
    let c = k === 0 ? i : tables[k - 1][i];
    if (k === 0) for (let bit = 0; bit < 8; ++bit) c = c & 1 ? (c >>> 1) ^ 0xedb88320 : c >>> 1;
    else c = (c >>> 8) ^ tables[0][c & 0xff];
    table[i] = c >>> 0;
  }
  tables.push(table);
}

/** CRC-32 of `bytes`, or of what came before with `bytes` appended. */
export function crc32(bytes: Uint8Array, before = 0): number {
  const [t0, t1, t2, t3, t4, t5, t6, t7] = tables;
  let c = ~before >>> 0;
  let i = 0;
  for (const end = bytes.length - 7; i < end; i += 8) {
    c ^= bytes[i] | (bytes[i + 1] << 8) | (bytes[i + 2] << 16) | (bytes[i + 3] << 24);
    c = t7[c & 0xff] ^ t6[(c >>> 8) & 0xff] ^ t5[(c >>> 16) & 0xff] ^ t4[c >>> 24] ^ t3[bytes[i + 4]] ^ t2[bytes[i + 5]] ^ t1[bytes[i + 6]] ^ t0[bytes[i + 7]];
  }
  for (; i < bytes.length; ++i) c = (c >>> 8) ^ t0[(c ^ bytes[i]) & 0xff];
  return ~c >>> 0;
}
