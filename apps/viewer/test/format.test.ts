// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { crc32 } from '../src/format/crc32';
import { evaluate } from '../src/format/expression';
import { halfToFloat } from '../src/format/half';
import { parseScene, SceneReader, texelsOf, type Plane } from '../src/format/reader';
import type { Scene } from '../src/format/ngsplat';
import { centersOf } from '../src/sort/sort';
import { CAMERA, crc, encode, TRAILER } from './encode';

const texels = (words: number, layers: number) => new Uint32Array(2048 * words * layers).map((_, i) => i);

describe('half', () => {
  it('decodes', () => {
    for (const [bits, value] of [
      [0x3c00, 1],
      [0xc100, -2.5],
      [0x0000, 0],
      [0x7bff, 65504],
      [0x0001, 2 ** -24],
      [0x0400, 2 ** -14],
      [0x7c00, Infinity],
    ])
      expect(halfToFloat(bits)).toBe(value);
    expect(halfToFloat(0x7e00)).toBeNaN();
  });
});

describe('crc32', () => {
  it('equals its definition at every length, whole and in parts', () => {
    const bytes = Uint8Array.from({ length: 40 }, (_, i) => (i * 97 + 13) & 0xff);
    expect(crc32(new TextEncoder().encode('123456789'))).toBe(0xcbf43926); // the polynomial's published check value
    for (let n = 0; n <= 40; ++n) expect(crc32(bytes.subarray(n), crc32(bytes.subarray(0, n)))).toBe(crc(bytes));
  });
});

describe('evaluate', () => {
  it.each([
    ['1 + 2 * 3 - 4', 3],
    ['(1 + 2) * 3 % 4', 1],
    ['(n + 7) / 8 * 8', 16],
    ['n >= 9 && n != 10 || 0', 1],
    ['!n ? 1 : n == 9 ? 2 : 3', 2],
    ['bands / 2 % 2 + (bands >= 8)', 2],
  ])('%s', (text, value) => expect(evaluate(text, { n: 9, bands: 14 })).toBe(value));

  it.each(['', '1 +', '(1', '1 2', 'm', 'toString', '1 ? 2', '1.5'])('refuses "%s"', (text) =>
    expect(() => evaluate(text, { n: 9 })).toThrow(/cannot be understood/),
  );
});

describe('parseScene', () => {
  it('reads a file without view dependence', () => {
    const scene = parseScene(encode());
    expect(scene.count).toBe(3);
    expect(scene.payload).toEqual([]);
    expect(scene.background).toEqual([1, 0.5, 0]);
    expect(scene.testCameras[0]).toMatchObject({
      right: [1, 0, 0],
      forward: [0, 0, 1],
      position: [0, 0, -3],
      fx: 100,
      cx: 32,
      width: 64,
    });
    expect([...centersOf(scene.geometry).subarray(0, 3)]).toEqual([1, -2.5, 0]);
  });

  it('reads what gsapp says about the model', () => {
    const trailer = {
      ...TRAILER,
      appearance: 'nasg',
      scene: 'lego',
      test_views: { psnr: 30.5, packed_psnr: 30.25, protocol: '' },
    };
    const frame = { center: [1, 2, 3], scale: 0.5 };
    expect(parseScene(encode({ trailer: { ...trailer, frame } })).frame).toEqual(frame);
    expect(parseScene(encode({ trailer }))).toMatchObject({
      appearance: 'nasg',
      name: 'lego',
      psnr: { model: 30.5, packed: 30.25 },
    });
  });

  it('reads a file of another program, without a trailer', () => {
    expect(parseScene(encode({ trailer: undefined }))).toMatchObject({ appearance: 'sh', background: [0, 0, 0] });
  });

  it.each([
    ['sh, degree 1', { model: 1, bandMask: 0b10, payload: texels(2, 1) }, [[2, 1]]],
    [
      'sh, degree 3',
      { model: 1, bandMask: 0b1110, payload: texels(10, 1) },
      [
        [2, 1],
        [4, 2],
      ],
    ],
    ['sv, 7 sites', { model: 2, featureDim: 7, payload: texels(4, 7) }, [[4, 7]]],
    ['nasg, 1 lobe', { model: 3, featureDim: 1, payload: texels(4, 2) }, [[4, 2]]],
    ['nasgabor, 2 lobes', { model: 4, featureDim: 2, payload: texels(4, 4) }, [[4, 4]]],
    [
      'neural, folded',
      {
        model: 0,
        featureDim: 16,
        bandMask: 0b1110,
        neurons: 16,
        hiddenLayers: 2,
        flags: 4,
        weights: new Uint16Array(4 * 140),
        payload: texels(4, 2),
      },
      [[4, 2]],
    ],
    [
      'neural of degrees 1, 4 and 6',
      {
        model: 0,
        featureDim: 16,
        bandMask: 0b1010010,
        neurons: 16,
        hiddenLayers: 1,
        flags: 4,
        weights: new Uint16Array(16 * (28 + 3)),
        payload: texels(4, 2),
      },
      [[4, 2]],
    ],
    // 16 features, the constant and 15 of the direction, all to 32 neurons, 32, 3.
    [
      'neural, whole',
      {
        model: 0,
        featureDim: 16,
        bandMask: 0b1110,
        neurons: 32,
        hiddenLayers: 2,
        weights: new Uint16Array(2144),
        payload: texels(4, 2),
      },
      [[4, 2]],
    ],
  ])('knows where the textures of %s lie', (_, fields, shape) => {
    const scene = parseScene(encode(fields));
    expect(scene.payload.map((b) => [b.words, b.layers])).toEqual(shape);
    expect(scene.payload.map((b) => b.data[0])).toEqual(
      scene.payload.map((_, k) => 2048 * scene.payload.slice(0, k).reduce((sum, b) => sum + b.words * b.layers, 0)),
    );
  });

  it('reads texels of the residuals that exist alone', () => {
    const some = parseScene(
      encode({
        count: 5000,
        numResiduals: 2049,
        model: 3,
        featureDim: 1,
        payload: new Uint32Array(2 * texels(4, 2).length),
      }),
    );
    expect(some).toMatchObject({
      count: 5000,
      textureHeight: 3,
      numResiduals: 2049,
      payloadHeight: 2,
      isInterleaved: false,
    });
    expect(
      parseScene(encode({ numResiduals: 2, flags: 512, model: 3, featureDim: 1, payload: texels(4, 2) })).isInterleaved,
    ).toBe(true);
    expect(some.payload[0].data.length).toBe(2 * 2048 * 4 * 2);
    const none = parseScene(encode({ count: 3, numResiduals: 0, model: 3, featureDim: 1 }));
    expect(none).toMatchObject({ numResiduals: 0, payloadHeight: 0 });
    expect(parseScene(encode({ model: 3, featureDim: 1, payload: texels(4, 2) }))).toMatchObject({
      numResiduals: 3,
      payloadHeight: 1,
    });
  });

  it('reads photometric values of every test view', () => {
    const numbers = Array.from({ length: 18 + 9 + 2 * 9 }, (_, i) => i + 1);
    const { photometric } = parseScene(encode({ testCameras: [CAMERA, CAMERA], photometric: numbers }));
    expect(photometric!.response[17]).toBe(18);
    expect(photometric!.neutral[0]).toBe(19);
    expect(photometric!.testViews[1][8]).toBe(45);
  });

  it('reads a file without Gaussians', () => {
    expect(parseScene(encode({ count: 0 }))).toMatchObject({ count: 0, textureHeight: 0 });
  });

  it('says where any truncated file ends', () => {
    const whole = encode({ model: 3, featureDim: 1, payload: texels(4, 2) });
    const cuts = [
      0,
      7,
      8,
      30,
      60,
      100,
      200,
      20000,
      whole.byteLength - 100,
      whole.byteLength - 30,
      whole.byteLength - 4,
      whole.byteLength - 1,
    ];
    for (const length of cuts)
      expect(() => parseScene(whole.slice(0, length)), `${length} bytes`).toThrow(
        /truncated|no \.ngsplat|unknown bytes/,
      );
  });

  const changed = (at: number, word: number) => {
    const bytes = encode();
    new DataView(bytes).setUint32(at, word, true);
    return bytes;
  };
  const withBytesBehind = (trailer: unknown) => {
    const file = new Uint8Array(encode({ trailer }));
    const longer = new Uint8Array(file.length + 12);
    longer.set(file);
    return longer.buffer;
  };
  const endOfTextures = encode({ trailer: undefined }).byteLength;

  it.each([
    ['another magic', changed(0, 0), /does not begin with NGSPLAT/],
    ['a count that is not true', changed(8, 5_000_000), /do not fill/],
    ['another width', changed(12, 1024), /width is 1024/],
    ['an unknown activation', changed(32, 9), /colour activation 9/],
    ['bands with a gap', encode({ bandMask: 0b1010 }), /shBandMask is 10, expected bands 1 to at most 3/],
    ['bands beyond the third', encode({ bandMask: 0b11110 }), /shBandMask is 30, expected/],
    [
      'directions beyond the sixth degree',
      encode({ model: 0, bandMask: 0b10000000, neurons: 16, hiddenLayers: 1, flags: 4 }),
      /shBandMask is 128, expected bands 1 to 6/,
    ],
    ['a model of a newer version', encode({ model: 7 }), /number 7 is unknown/],
    ['flags of a newer version', changed(48, 8 | (1 << 10)), /newer/],
    [
      'as many residuals as Gaussians',
      encode({ numResiduals: 3, model: 3, featureDim: 1, payload: texels(4, 2) }),
      /3 of 3 Gaussians have a residual/,
    ],
    [
      'fewer texels than residuals',
      encode({ count: 5000, numResiduals: 2049, model: 3, featureDim: 1, payload: texels(4, 2) }),
      /truncated: appearance of 2049 Gaussians|unknown bytes|would take/,
    ],
    ['more cameras than bytes', changed(100, 0xffffffff), /truncated: 4294967295 test cameras/],
    [
      'another number of weights',
      encode({ model: 0, featureDim: 16, bandMask: 2, neurons: 16, hiddenLayers: 1, flags: 4, payload: texels(4, 2) }),
      /0 texels of weights, its model 28/,
    ],
    [
      'a network of no known size',
      encode({ model: 0, neurons: 0xfffffffc, hiddenLayers: 0x7fffffff }),
      /nNeurons is 4294967292, expected a multiple of 4 up to 256/,
    ],
    [
      'more numbers per Gaussian than the format has',
      encode({ model: 2, featureDim: 1000 }),
      /featureDim is 1000, expected at most 9 sites/,
    ],
    ['a camera that is not finite', encode({ testCameras: [[NaN, ...CAMERA.slice(1)]] }), /not a finite number/],
    ['a camera without pixels', encode({ testCameras: [[...CAMERA.slice(0, 16), 0, 0]] }), /0 x 0 pixels/],
    ['a changed byte', changed(400, 1), /checksum is .* damaged/],
    ['a trailer of a newer version', changed(endOfTextures + 8, 2), /version 2, this viewer reads 1/],
    [
      'bytes behind the checksum',
      withBytesBehind({ appearance: 'sh', background: [0, 0, 0] }),
      /12 bytes follow the checksum/,
    ],
    ['bytes behind the textures', withBytesBehind(undefined), /12 unknown bytes follow/],
    ['a trailer without what it must have', encode({ trailer: { appearance: 1 } }), /lacks/],
    ['a trailer with half a frame', encode({ trailer: { ...TRAILER, frame: { center: [0, 0, 0] } } }), /frame/],
  ])('refuses %s', (_, bytes, message) => {
    expect(() => parseScene(bytes)).toThrow(message);
  });

  it.each([null, '1', true, 1e300])('refuses %j as a colour of the background', (value) => {
    expect(() => parseScene(encode({ trailer: { appearance: 'sh', background: [0, value, 0] } }))).toThrow(
      /is no number/,
    );
  });
});

describe('SceneReader', () => {
  /** Notes what it is given. */
  class Notes {
    scene: Scene | undefined;
    parts: [plane: Plane, row: number, texels: Uint32Array, buffer: ArrayBufferLike][] = [];
    begin(scene: Scene): void {
      this.scene = scene;
    }
    rows(plane: Plane, row: number, texels: Uint32Array): void {
      this.parts.push([plane, row, texels.slice(), texels.buffer]);
    }
  }
  const COUNT = 100_000;
  const ROWS = 49;
  const large = new Uint8Array(
    encode({ count: COUNT, model: 3, featureDim: 1, payload: texels(4, 2 * ROWS).map((word) => word & 0x3bff3bff) }),
  );

  it('hands on what arrives, and never keeps more than a part of it', () => {
    const sink = new Notes();
    const reader = new SceneReader(sink);
    for (let at = 0; at < large.length; at += 60_000) reader.push(large.subarray(at, at + 60_000));
    const buffers = new Set(sink.parts.map(([, , , buffer]) => buffer));
    expect(buffers.size).toBe(1);
    expect([...buffers][0].byteLength).toBeLessThanOrEqual(1 << 20);
    const whole = parseScene(large.buffer);
    for (const [plane, row, part] of sink.parts) {
      const from = plane.block < 0 ? whole.geometry : whole.payload[plane.block].data;
      const at = 2048 * plane.words * (plane.layer * plane.rows + row);
      expect(part.every((word, i) => word === from[at + i])).toBe(true);
    }
    expect(sink.parts.reduce((sum, [, , part]) => sum + part.byteLength, 0)).toBe(3 * ROWS * 2048 * 16);
    expect(reader.finish()).toMatchObject({ background: [1, 0.5, 0], geometry: new Uint32Array() });
  });

  it('knows how long the file is as soon as its header is there, and hands on rows of the geometry at once', () => {
    const sink = new Notes();
    const reader = new SceneReader(sink);
    reader.push(large.subarray(0, 100));
    expect(reader.end).toBeUndefined();
    reader.push(large.subarray(100, 3 * 32768));
    const { end } = reader;
    expect(large.length - end!).toBeLessThan(200); // the trailer
    expect(sink.parts.map(([plane, row, part]) => [plane.block, row, part.length])).toEqual([[-1, 0, 2 * 2048 * 4]]);
  });

  it('takes no memory for a header that promises more than the file has', () => {
    const sink = new Notes();
    const file = large.slice(0, 5000);
    expect(() => new SceneReader(sink, file.length).push(file)).toThrow(
      /truncated: geometry of 100000 Gaussians would take/,
    );
    expect(sink.scene).toBeUndefined();
    const cameras = new Uint8Array(encode());
    new DataView(cameras.buffer).setUint32(100, 0xffffffff, true);
    const reader = new SceneReader(sink);
    for (let i = 0; i < 3; ++i) reader.push(cameras);
    expect(() => reader.finish()).toThrow(/truncated: 4294967295 test cameras/);
  });

  it('stops where a file without end goes on behind its texels', () => {
    const reader = new SceneReader(new Notes());
    reader.push(new Uint8Array(encode()));
    expect(() => {
      for (let i = 0; i < 100; ++i) reader.push(new Uint8Array(1 << 16));
    }).toThrow(/more than 1048576 bytes follow/);
  });

  it('gives the texels of a scene as a file brings them, and lets go of them', () => {
    const sink = new Notes();
    const scene = parseScene(large.buffer);
    const collected = parseScene(large.buffer);
    new SceneReader(sink).push(large);
    const parts = [...texelsOf(scene)].map(([plane, row, part]) => [
      plane.block,
      plane.layer,
      row,
      part.length,
      part[77],
    ]);
    expect(parts.reduce((sum, part) => sum + part[3], 0)).toBe(3 * ROWS * 2048 * 4);
    expect(parts.at(-1)![4]).toBe(collected.payload[0].data[2048 * 4 * (ROWS + 32) + 77]);
    expect([scene.geometry.length, scene.payload[0].data.length]).toEqual([0, 0]);
  });
});
