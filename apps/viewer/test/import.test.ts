// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from 'node:fs';
import { gzipSync } from 'node:zlib';
import { describe, expect, it } from 'vitest';
import { floatToHalf, halfToFloat } from '../src/format/half';
import { importScene, isNgsplat } from '../src/format/import';
import { ColorActivation, type Scene } from '../src/format/ngsplat';
import {
  columnsOf,
  covariance,
  decoded,
  encodePly,
  encodeSplat,
  encodeSpz,
  encodeSpz4,
  sigmoid,
  someGaussians,
  spzStream,
  type Gaussian,
} from './encode_others';

const bytesOf = (data: Uint8Array | number[] | string): ArrayBuffer =>
  Uint8Array.from(typeof data === 'string' ? new TextEncoder().encode(data) : data).buffer;
const Y0 = 0.28209479177387814;

/** What rounding of the file's own format adds to that of the scene. */
interface Loss {
  mean?: number;
  /** In the logarithm of the standard deviations. */
  scale?: number;
  /** Radians. */
  rotation?: number;
  color?: number;
  rest?: number;
}

function expectGaussians(scene: Scene, wanted: Gaussian[], loss: Loss = {}): void {
  expect(scene.count).toBe(wanted.length);
  wanted.forEach((g, i) => {
    const seen = decoded(scene, i);
    const size = g.logScale.map(Math.exp);
    const what = `Gaussian ${i}`;
    g.mean.forEach((x, k) =>
      expect(Math.abs(seen.mean[k] - x), `${what}, mean`).toBeLessThanOrEqual(
        Math.abs(x) * 2 ** -11 + 1e-7 + (loss.mean ?? 0),
      ),
    );
    // Steps of the standard deviations are 8.3 %, those of the rotation half a degree.
    const [a, b] = [covariance(seen.rotation, seen.size), covariance(g.rotation, size)];
    const largest = Math.max(...size) ** 2;
    a.forEach((x, k) =>
      expect(Math.abs(x - b[k]), `${what}, covariance`).toBeLessThanOrEqual(
        largest * (0.1 + 2 * (loss.scale ?? 0) + 2 * (loss.rotation ?? 0)),
      ),
    );
    expect(Math.abs(seen.opacity - sigmoid(g.logit)), `${what}, opacity`).toBeLessThanOrEqual(
      0.1 * sigmoid(g.logit) + 1 / 255,
    );
    g.dc.forEach((dc, c) =>
      expect(Math.abs(seen.base[c] - (Y0 * dc + 0.5)), `${what}, colour`).toBeLessThanOrEqual(
        scene.baseScale * 0.51 + (loss.color ?? 0),
      ),
    );
    expect(seen.rest.length).toBe(g.rest.length);
    g.rest.forEach((rgb, j) =>
      rgb.forEach((value, c) => {
        const step = scene.floats[j < 3 ? 0 : j < 8 ? 1 : 2] / [63, 127, 31][j < 3 ? 0 : j < 8 ? 1 : 2];
        expect(Math.abs(seen.rest[j][c] - value), `${what}, coefficient ${j}`).toBeLessThanOrEqual(
          0.51 * step + (loss.rest ?? 0),
        );
      }),
    );
  });
}

const SOME = 40;

describe('floatToHalf', () => {
  it('is the inverse of halfToFloat, and rounds to the nearest', () => {
    const wrong: number[] = [];
    for (let bits = 0; bits < 0x7bff; ++bits) {
      const value = halfToFloat(bits);
      const step = halfToFloat(bits + 1) - value;
      const found = [value, value + 0.49 * step, value + 0.51 * step, -value - 0.49 * step].map(floatToHalf);
      if (found.some((half, k) => half !== [bits, bits, bits + 1, bits | 0x8000][k])) wrong.push(bits);
    }
    expect(wrong).toEqual([]);
    expect([1e9, -1e9, Infinity].map((x) => halfToFloat(floatToHalf(x)))).toEqual([65504, -65504, 65504]);
  });
});

describe('importScene of .ply', () => {
  it.each([0, 1, 2, 3])('reads Gaussians of degree %d', async (degree) => {
    const wanted = someGaussians(SOME, degree);
    const { scene, remarks } = await importScene('a.ply', encodePly(columnsOf(wanted)));
    expectGaussians(scene, wanted);
    expect(remarks).toEqual([]);
    expect(scene).toMatchObject({
      appearance: degree ? 'sh' : 'none',
      antialiased: false,
      constants: { GS_DEGREE: degree },
      colorActivation: ColorActivation.Relu,
      testCameras: [],
    });
    expect(scene.payload.map(({ words, layers }) => [words, layers])).toEqual(
      [
        [],
        [[2, 1]],
        [
          [2, 1],
          [4, 1],
        ],
        [
          [2, 1],
          [4, 2],
        ],
      ][degree],
    );
  });

  it('finds columns by their names: in any order, of any type, among others, with line ends of either kind', async () => {
    const wanted = someGaussians(SOME, 2);
    const columns = columnsOf(wanted);
    const others = {
      confidence: wanted.map((_, i) => i),
      ...Object.fromEntries(
        Object.entries(columns)
          .filter(([name]) => !name.startsWith('n'))
          .reverse(),
      ),
      label: wanted.map((_, i) => i - 5),
    };
    const types = { confidence: 'uchar', label: 'short', x: 'double', f_rest_3: 'double', opacity: 'double' };
    for (const lineEnd of ['\n', '\r\n'])
      expectGaussians((await importScene('a.ply', encodePly(others, { types, lineEnd }))).scene, wanted);
  });

  it('reads big-endian files, and passes over elements in front', async () => {
    const wanted = someGaussians(SOME, 1);
    const before = {
      lines: ['element camera 3', 'property float focal', 'property uchar kind'],
      bytes: new Uint8Array(15).fill(255),
    };
    expectGaussians(
      (await importScene('a.ply', encodePly(columnsOf(wanted), { bigEndian: true, before }))).scene,
      wanted,
    );
  });

  it('reads whole numbers as such', async () => {
    const wanted = someGaussians(4, 0).map((g, i) => ({
      ...g,
      mean: [i, -i, 2],
      dc: [1, 0, -1],
      rotation: [1, 0, 0, 0],
    }));
    const types = Object.fromEntries(
      ['x', 'y', 'z', 'f_dc_0', 'f_dc_1', 'f_dc_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3'].map((name) => [name, 'int']),
    );
    expectGaussians((await importScene('a.ply', encodePly(columnsOf(wanted), { types }))).scene, wanted);
  });

  it('takes colours of bytes where there are no coefficients', async () => {
    const wanted = someGaussians(SOME, 0).map((g) => ({ ...g, logit: 2 }));
    const columns = columnsOf(wanted);
    const rgb = wanted.map((_, i) => 6 * i);
    for (const k of [0, 1, 2]) delete columns[`f_dc_${k}`];
    const types = { red: 'uchar', green: 'uchar', blue: 'uchar' };
    const { scene } = await importScene('a.ply', encodePly({ ...columns, red: rgb, green: rgb, blue: rgb }, { types }));
    expectGaussians(
      scene,
      wanted.map((g, i) => ({ ...g, dc: [0, 1, 2].map(() => (rgb[i] / 255 - 0.5) / Y0) })),
    );
  });

  it('knows what gsapp says of antialiasing', async () => {
    const columns = columnsOf(someGaussians(3, 0));
    for (const [mode, antialiased] of [
      ['default', false],
      ['mip', true],
      ['mip-0.1', true],
    ] as const)
      expect(
        (await importScene('a.ply', encodePly(columns, { comments: [`SplatRenderMode: ${mode}`] }))).scene.antialiased,
      ).toBe(antialiased);
  });

  it('takes the axis that is up from a comment, as nerfstudio writes it', async () => {
    const columns = columnsOf(someGaussians(3, 0));
    const upOf = async (comments: string[]) => (await importScene('a.ply', encodePly(columns, { comments }))).scene.up;
    expect(await upOf([])).toEqual([0, -1, 0]);
    expect(await upOf(['Generated by Nerfstudio', 'Vertical Axis: z'])).toEqual([0, 0, 1]);
  });

  it('reads colours before another activation', async () => {
    const wanted = someGaussians(SOME, 1);
    const columns = columnsOf(wanted);
    [0, 1, 2].forEach((k) => (columns[`app_base_${k}`] = wanted.map((g) => Math.fround(Y0 * g.dc[k]))));
    [0, 1, 2].forEach((k) => columns[`f_dc_${k}`].fill(0));
    for (const [word, activation, shift] of [
      ['softplus', ColorActivation.Softplus, 0.5],
      ['sigmoid', ColorActivation.Sigmoid, 0],
    ] as const) {
      const { scene, remarks } = await importScene(
        'a.ply',
        encodePly(columns, { comments: [`gsapp appearance sh max_degree 1 active_degree 1 activation ${word}`] }),
      );
      expect([scene.colorActivation, remarks]).toEqual([activation, []]);
      expectGaussians({ ...scene, baseOffset: scene.baseOffset + 0.5 - shift }, wanted);
    }
  });

  it('shows the base colour of other models, and says so', async () => {
    const wanted = someGaussians(SOME, 0);
    const columns = { ...columnsOf(wanted), app_nasg_0: wanted.map(() => 7) };
    const { scene, remarks } = await importScene(
      'a.ply',
      encodePly(columns, { comments: ['gsapp appearance nasg max_degree 0 active_degree 0 activation relu'] }),
    );
    expectGaussians(scene, wanted);
    expect(remarks.join()).toMatch(/model is 'nasg', of which the base colour is shown/);
  });

  it('leaves out what is not finite, and counts it', async () => {
    const wanted = someGaussians(SOME, 1);
    const columns = columnsOf(wanted);
    columns.x[3] = NaN;
    columns.f_rest_8[5] = Infinity;
    columns.scale_1[7] = 1000;
    [0, 1, 2, 3].forEach((k) => (columns[`rot_${k}`][9] = 0));
    columns.opacity[11] = Infinity; // an opacity of 1
    columns.scale_2[12] = -Infinity; // flat
    const { scene, remarks } = await importScene('a.ply', encodePly(columns));
    const rest = wanted.map((g, i) =>
      i === 11 ? { ...g, logit: 50 } : i === 12 ? { ...g, logScale: [g.logScale[0], g.logScale[1], -100] } : g,
    );
    expectGaussians(
      scene,
      rest.filter((_, i) => ![3, 5, 7, 9].includes(i)),
    );
    expect(remarks).toEqual([expect.stringMatching(/^4 of 40 Gaussians are left out/)]);
  });

  it('shows models far from the origin, or of another size, in a frame that suits them', async () => {
    const wanted = someGaussians(SOME, 0);
    for (const [offset, scale] of [
      [[500, 0, -200], 1],
      [[5e6, 3e6, 100], 1],
      [[0, 0, 0], 1e4],
      [[20, 0, 0], 1e-3],
    ] as const) {
      const moved = wanted.map((g) => ({
        ...g,
        mean: g.mean.map((x, k) => offset[k] + scale * x),
        logScale: g.logScale.map((s) => s + Math.log(scale)),
      }));
      const types = { x: 'double', y: 'double', z: 'double' };
      const { scene, remarks } = await importScene('a.ply', encodePly(columnsOf(moved), { types }));
      expect(remarks.join()).toMatch(/^Its coordinates are shown .*relative to/);
      // Distances between Gaussians are as before, by a factor that is 1 where the size is usual.
      const [a, b] = [decoded(scene, 1), decoded(scene, 2)];
      const distance = (p: number[], q: number[]) => Math.hypot(...p.map((x, k) => x - q[k]));
      const factor = distance(a.mean, b.mean) / distance(wanted[1].mean, wanted[2].mean);
      if (scale === 1) expect(Math.abs(factor - 1)).toBeLessThan(0.002);
      expect(Math.max(...a.size) / Math.max(...wanted[1].logScale.map(Math.exp)) / factor).toBeCloseTo(1, 0);
      expect(scene.distance).toBeGreaterThan(1);
      expect(scene.distance).toBeLessThan(20);
      expect(Math.hypot(...scene.center)).toBeLessThan(1e-9);
    }
  });

  it('keeps the frame of usual models', async () => {
    const { scene } = await importScene(
      'a.ply',
      encodePly(
        columnsOf(someGaussians(SOME, 0).map((g) => ({ ...g, mean: [g.mean[0] + 3, g.mean[1] - 2, g.mean[2]] }))),
      ),
    );
    expect(scene.center[0]).toBeGreaterThan(2);
    expect(scene.up).toEqual([0, -1, 0]);
  });

  it('cuts degree 4 to 3, and says so', async () => {
    const wanted = someGaussians(SOME, 4);
    const { scene, remarks } = await importScene('a.ply', encodePly(columnsOf(wanted)));
    expectGaussians(
      scene,
      wanted.map((g) => ({ ...g, rest: g.rest.slice(0, 15) })),
    );
    expect(remarks.join()).toMatch(/of degree 4, those up to degree 3/);
  });

  it('shows coloured points as dots', async () => {
    const points = {
      x: [0, 1, 2, 3],
      y: [0, 1, 0, 1],
      z: [1, 1, 2, 2],
      red: [0, 255, 51, 51],
      green: [255, 0, 0, 51],
      blue: [0, 0, 255, 102],
    };
    const { scene, remarks } = await importScene(
      'a.ply',
      encodePly(points, { types: { red: 'uchar', green: 'uchar', blue: 'uchar' } }),
    );
    expect(remarks.join()).toMatch(/point cloud/);
    const { mean, base, size, opacity } = decoded(scene, 3);
    expect(mean).toEqual([3, 1, 2]);
    expect(opacity).toBeGreaterThan(0.95);
    [0.2, 0.2, 0.4].forEach((x, c) => expect(base[c]).toBeCloseTo(x, 2));
    expect(size[0]).toBeGreaterThan(0.1);
    expect(size[0]).toBeLessThan(1.5);
    expect(new Set(size).size).toBe(1);
  });

  const columns = columnsOf(someGaussians(3, 1));
  const without = (...names: string[]) =>
    Object.fromEntries(Object.entries(columns).filter(([name]) => !names.includes(name)));
  it.each([
    [
      'a file that ends too early',
      encodePly(columns).slice(0, -1),
      /truncated: 3 vertices take \d+ bytes, but only \d+ follow/,
    ],
    ['more Gaussians than bytes', encodePly(columns, { count: 4_000_000_000 }), /truncated: 4000000000 vertices/],
    ['a header without end', bytesOf('ply\nformat binary_little_endian 1.0\nelement vertex 3\n'), /no line end_header/],
    ['text', bytesOf('ply\nformat ascii 1.0\nelement vertex 0\nend_header\n'), /format ascii/],
    [
      'another format',
      bytesOf('ply\nformat binary_middle_endian 1.0\nend_header\n'),
      /'binary_middle_endian' is unknown/,
    ],
    ['no vertices', bytesOf('ply\nformat binary_little_endian 1.0\nelement face 0\nend_header\n'), /no element vertex/],
    ['no Gaussians', encodePly(columnsOf([]), {}), /no property x, y, z|no Gaussians/],
    [
      'none at all',
      encodePly(Object.fromEntries(Object.keys(columns).map((name) => [name, []]))),
      /it holds no Gaussians/,
    ],
    ['none that is finite', encodePly({ ...columns, y: [NaN, NaN, NaN] }), /none of its Gaussians has finite numbers/],
    [
      'points without colours',
      encodePly({ x: [1], y: [1], z: [1] }),
      /no property scale_0, .*rot_3, opacity, f_dc_0.*point cloud without colours/,
    ],
    ['Gaussians without one column', encodePly(without('rot_2')), /no property rot_2$/],
    ['Gaussians without positions', encodePly(without('x', 'z')), /no property x, z$/],
    [
      'another number of coefficients',
      encodePly(without('f_rest_8')),
      /8 properties f_rest_\*, expected 0, 9, 24 or 45/,
    ],
    [
      'a property twice',
      bytesOf(
        'ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float x\nend_header\n',
      ),
      /property x twice/,
    ],
    [
      'a property of an unknown type',
      bytesOf('ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty quad x\nend_header\n'),
      /line 'property quad x'/,
    ],
    [
      'a count that is none',
      bytesOf('ply\nformat binary_little_endian 1.0\nelement vertex -1\nend_header\n'),
      /line 'element vertex -1'/,
    ],
    [
      'lists in the vertices',
      bytesOf(
        'ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nproperty list uchar int n\nend_header\n',
      ),
      /vertices have lists/,
    ],
    [
      'a compressed file',
      encodePly({ packed_position: [1], packed_rotation: [1] }),
      /: npx @playcanvas\/splat-transform in\.compressed\.ply out\.ply$/,
    ],
  ])('refuses %s', async (_, bytes, message) => expect(importScene('a.ply', bytes)).rejects.toThrow(message));
});

describe('importScene of .splat', () => {
  it('reads Gaussians of one colour', async () => {
    const wanted = someGaussians(SOME, 0);
    const { scene, remarks } = await importScene('A.SPLAT', encodeSplat(wanted));
    expectGaussians(scene, wanted, { rotation: 0.01, color: 1 / 255 });
    expect([scene.appearance, remarks]).toEqual(['none', []]);
  });

  it('refuses parts of Gaussians, and none', async () => {
    await expect(importScene('a.splat', new ArrayBuffer(33))).rejects.toThrow(/33 bytes, which is no multiple of 32/);
    await expect(importScene('a.splat', new ArrayBuffer(0))).rejects.toThrow(/holds no Gaussians/);
  });
});

describe('importScene of .spz', () => {
  const loss = (version: number): Loss => ({
    mean: version === 1 ? 0.002 : 2 ** -13,
    scale: 1 / 32,
    rotation: version < 3 ? 0.06 : 0.01,
    color: Y0 / 0.15 / 510 + 1e-6,
    rest: 1 / 256,
  });

  it.each([1, 2, 3])('reads Gaussians of version %d', async (version) => {
    for (const degree of [0, 1, 2, 3]) {
      const wanted = someGaussians(SOME, degree);
      const { scene, remarks } = await importScene('a.spz', encodeSpz(wanted, { version }));
      expectGaussians(scene, wanted, loss(version));
      expect([scene.antialiased, remarks]).toEqual([false, []]);
    }
  });

  it('reads Gaussians of version 4', async () => {
    for (const degree of [0, 1, 3]) {
      const wanted = someGaussians(SOME, degree);
      for (const extensions of [[], [1, 2, 3, 4, 5]])
        expectGaussians((await importScene('a.spz', encodeSpz4(wanted, extensions))).scene, wanted, loss(3));
    }
  });

  // splat-transform 2.7.1 wrote these from the .ply of the same Gaussians.
  it.each([3, 4])('reads version %d of another program', async (version) => {
    const file = readFileSync(new URL(`data/version${version}.spz`, import.meta.url));
    expectGaussians((await importScene('a.spz', bytesOf(file))).scene, someGaussians(30, 2), {
      ...loss(3),
      rest: 8.5 / 128,
    }); // it keeps 4 bits
  });

  it('reads rotations of which any number is the largest', async () => {
    const wanted = someGaussians(8, 0).map((g, n) => ({
      ...g,
      rotation: [0.3, -0.2, 0.4, -0.1].map((x, k) => (k === n >> 1 ? 1 - 2 * (n & 1) : x)),
    }));
    for (const version of [2, 3])
      expectGaussians((await importScene('a.spz', encodeSpz(wanted, { version }))).scene, wanted, loss(version));
  });

  it('knows antialiasing, extensions and degree 4', async () => {
    const wanted = someGaussians(SOME, 4);
    const { scene, remarks } = await importScene('a.spz', encodeSpz(wanted, { flags: 3, behind: [1, 2, 3] }));
    expectGaussians(
      scene,
      wanted.map((g) => ({ ...g, rest: g.rest.slice(0, 15) })),
      loss(3),
    );
    expect(scene.antialiased).toBe(true);
    expect(remarks.join()).toMatch(/of degree 4, those up to degree 3/);
  });

  const some = someGaussians(3, 1);
  const changed = (file: ArrayBuffer, at: number, byte: number) =>
    Uint8Array.from(new Uint8Array(file), (old, i) => (i === (at + file.byteLength) % file.byteLength ? byte : old))
      .buffer;
  it.each([
    ['a stream that ends too early', encodeSpz(some).slice(0, -9), /gzip stream is truncated or damaged/],
    [
      'fewer Gaussians than declared',
      encodeSpz(some, { count: 4 }),
      /truncated: 4 Gaussians take \d+ bytes, but only \d+ follow/,
    ],
    [
      'more Gaussians than can be packed',
      encodeSpz(some, { count: 4_000_000_000 }),
      /4000000000 Gaussians take .* more than \d+ can hold compressed/,
    ],
    ['more bytes than declared', encodeSpz(some, { behind: [1] }), /more follows than the 3 Gaussians/],
    ['something else', encodeSpz(some, { magic: 1 }), /does not begin as \.spz does/],
    ['version 0', encodeSpz(some, { version: 0 }), /version 0/],
    ['degree 5', encodeSpz(some, { degree: 5 }), /degree 5, expected at most 4/],
    ['no header', bytesOf([...gzipSync(spzStream(some).subarray(0, 15))]), /header is not complete/],
    ['no Gaussians', encodeSpz([]), /holds no Gaussians/],
    ['version 4 that ends too early', encodeSpz4(some).slice(0, -1), /truncated: stream 5/],
    ['a damaged stream', changed(encodeSpz4(some), -30, 0xff), /zstd streams is damaged/],
    ['another number of streams', changed(encodeSpz4(some), 15, 5), /5 streams, expected 6 for degree 1/],
    ['a table inside of the header', changed(encodeSpz4(some), 16, 16), /table of streams begins at byte 16/],
    [
      'a stream of another length',
      changed(encodeSpz4(some), 32 + 8, 1),
      /stream 0 has 1 bytes, but 3 Gaussians take 27/,
    ],
    ['a count that is not true', changed(encodeSpz4(some), 11, 200), /stream 0 has 27 bytes/],
    [
      'a newer version',
      bytesOf([...new TextEncoder().encode('NGSP'), 5, ...new Uint8Array(40)]),
      /version 5; the viewer reads versions 1 to 4/,
    ],
    ['version 3 that is not compressed', bytesOf(spzStream(some)), /version 3, but not compressed/],
    ['version 4 in gzip', encodeSpz(some, { version: 4 }), /version 4, but compressed with gzip/],
  ])('refuses %s', async (_, bytes, message) => expect(importScene('a.spz', bytes)).rejects.toThrow(message));
});

describe('importScene', () => {
  it('goes by what a file begins with, and then by its name', async () => {
    const wanted = someGaussians(2, 0);
    for (const bytes of [encodePly(columnsOf(wanted)), encodeSpz(wanted)])
      expect((await importScene('a.splat', bytes)).scene.count).toBe(2);
    expect((await importScene('a b.v2.Splat', encodeSplat(wanted))).scene.count).toBe(2);
    expect(isNgsplat('a.ply', bytesOf('NGSPLAT\n'))).toBe(true);
    expect(isNgsplat('a.ngsplat', bytesOf('anything'))).toBe(true);
    expect(isNgsplat('a.ngsplat', bytesOf('ply\nformat'))).toBe(false);
    expect(isNgsplat('a.ply', bytesOf('ply\nformat'))).toBe(false);
  });

  it.each([
    ['a.sog', 'PK\x03\x04', /does not read \.sog files; .*: npx @playcanvas\/splat-transform in\.sog out\.ply$/],
    ['meta', 'PK\x03\x04', /: npx @playcanvas\/splat-transform in\.sog out\.ply$/],
    ['a.ksplat', 'anything', /: npx @playcanvas\/splat-transform in\.ksplat out\.ply$/],
    ['a.lcc', '{}', /: npx @playcanvas\/splat-transform in\.lcc out\.ply$/],
    ['A.LCC2', 'anything', /: npx @playcanvas\/splat-transform in\.lcc2 out\.ply$/],
    [
      'meta.json',
      '{"version":2}',
      /does not read folders of SOG; .*: npx @playcanvas\/splat-transform meta\.json out\.ply$/,
    ],
    ['other.json', '{"version":2}', /reads \.ngsplat, \.ply, \.splat and \.spz files/],
    ['a.glb', 'glTF', /reads \.ngsplat, \.ply, \.splat and \.spz files/],
    ['a.obj', 'v 0 0 0', /reads \.ngsplat, \.ply, \.splat and \.spz files/],
    ['a.ply', '', /this is none of them/],
  ])('says of %s what to do', async (name, text, message) =>
    expect(importScene(name, bytesOf(text))).rejects.toThrow(message),
  );
});
