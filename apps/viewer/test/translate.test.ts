// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import colors from '../src/render/colors.glsl?raw';
import gaussian from '../src/render/gaussian.glsl?raw';
import { models } from '../src/models';
import { Parameters } from '../src/webgpu/parameters';
import { preprocess } from '../src/webgpu/preprocess';
import { translate, type Known } from '../src/webgpu/translate';

/** WGSL of the statements of a function, one a line. */
function body(statements: string, known: Record<string, Known> = {}): string[] {
  return translate(`void f() { ${statements} }`, {}, known).split('\n').slice(2, -2);
}

describe('preprocess', () => {
  const kept = (source: string, defines = {}) =>
    preprocess(source, defines)
      .split('\n')
      .map((line) => line.trim())
      .filter(Boolean);

  it('keeps the branch that is true, and no other', () => {
    const source = '#if GS_A == 1\none\n#elif GS_A > 1 // more\nmany\n#else\nnone\n#endif\nend';
    expect([0, 1, 2].map((a) => kept(source, { GS_A: a }))).toEqual([
      ['none', 'end'],
      ['one', 'end'],
      ['many', 'end'],
    ]);
  });

  it('does not look into a branch that is not taken', () => {
    expect(kept('#if GS_A\n#if GS_UNKNOWN\nx\n#else\ny\n#endif\n#endif\nz', { GS_A: false })).toEqual(['z']);
    expect(kept('#if GS_A\n#if !GS_B\nx\n#else\ny\n#endif\n#endif', { GS_A: true, GS_B: true })).toEqual(['y']);
  });

  it('puts values in place of whole names', () => {
    expect(kept('int a[GS_N / 4], GS_NN;', { GS_N: 8 })).toEqual(['int a[8 / 4], GS_NN;']);
  });

  it.each([
    ['#if GS_A', 'cannot be understood'],
    ['#if 1', 'has no #endif'],
    ['#endif', 'cannot be translated'],
    ['#else', 'cannot be translated'],
    ['#define A 1', 'cannot be translated'],
  ])('refuses %s', (source, message) => {
    expect(() => preprocess(source, {})).toThrow(message);
  });
});

describe('translate', () => {
  it('gives operators brackets, in the order in which they bind', () => {
    expect(body('int a = 1 + 2 * 3 - 4; bool b = a < 3 || a == 4 && !(a > 5);')).toEqual([
      'var a_: i32 = ((1 + (2 * 3)) - 4);',
      'var b_: bool = ((a_ < 3) || ((a_ == 4) && (!(a_ > 5))));',
    ]);
    expect(body('int a = 12 >> 2 & 1;')).toEqual(['var a_: i32 = ((12 >> u32(2)) & 1);']);
  });

  it('converts what constructors take, and widens scalars beside vectors', () => {
    expect(body('uint u = 255u; vec3 v = max(vec3(u & 1u, 2, 0.5), 0.0);')).toEqual([
      'var u_: u32 = 255u;',
      'var v_: vec3f = max(vec3f(f32((u_ & 1u)), f32(2), 0.5), vec3f(0.0));',
    ]);
    expect(body('vec2 v = vec2(1.0), w = 2.0 * v; float d = dot(v, w);').join()).toContain(
      'var w_: vec2f = (2.0 * v_); var d_: f32 = dot(v_, w_);'.split(' var')[0],
    );
  });

  it('knows the types of elements and components', () => {
    expect(body('uvec4 g; float x = float(g.xz[1]) + vec3(g.wzy).r; ').at(-1)).toBe(
      'var x_: f32 = (f32(g_.xz[1]) + vec3f(vec3f(g_.wzy)).x);',
    );
    expect(body('mat3 m; vec3 v = m * vec3(m[0].x); vec2 w = clamp(v.xy, 0.0, m[1][2]);').at(-1)).toBe(
      'var w_: vec2f = clamp(v_.xy, vec2f(0.0), vec2f(m_[1][2]));',
    );
  });

  it('assigns to several components one by one', () => {
    expect(body('vec3 v; v.xz += 0.5; v.yx = v.xy;').slice(1)).toEqual([
      '{ let parts = (v_.xz + 0.5); v_.x = parts.x; v_.z = parts.y; };',
      '{ let parts = v_.xy; v_.y = parts.x; v_.x = parts.y; };',
    ]);
  });

  it('counts up behind the statement', () => {
    expect(body('int n = 0; float a[4]; a[n++] = 1.0; n++; --n;').slice(2)).toEqual([
      'a_[n_] = 1.0; n_ += 1;',
      'n_ += 1;',
      'n_ -= 1;',
    ]);
    expect(() => translate('int f(int n) { return n++; }', {})).toThrow(
      "line 1 of the GLSL cannot be translated: '++' is understood in statements only",
    );
  });

  it('keeps branches and loops', () => {
    expect(body('for (int i = 0, n = 2; i < n; ++i) if (i == 1) continue; else break;').join(' ')).toBe(
      '{ var i_: i32 = 0; var n_: i32 = 2; for (; (i_ < n_); i_ += 1) { if ((i_ == 1)) { continue; } else { break; } } }',
    );
  });

  it('makes parameters variables, and those that go out pointers', () => {
    expect(
      translate(
        'float f(float x, out vec2 y) { x += 1.0; y = vec2(x); return y.x; } void g() { vec2 a; f(1.0, a); }',
        {},
      ),
    ).toBe(
      [
        'fn f_(x_in: f32, y_in: ptr<function, vec2f>) -> f32 {',
        'var x_ = x_in;',
        '{',
        'x_ += 1.0;',
        '(*y_in) = vec2f(x_);',
        'return (*y_in).x;',
        '}',
        '}',
        'fn g_() {',
        '{',
        'var a_: vec2f;',
        'f_(1.0, &a_);',
        '}',
        '}',
      ].join('\n'),
    );
  });

  it('has constants, arrays and what stands elsewhere', () => {
    expect(
      translate(
        'const int n = 4; float[n] f() { float a[n]; return a; } float g() { return scale * f()[1]; }',
        {},
        { scale: { type: 'float', code: 'data.scale' } },
      ),
    ).toBe(
      [
        'const n_: i32 = 4;',
        'fn f_() -> array<f32, (n_)> {',
        '{',
        'var a_: array<f32, (n_)>;',
        'return a_;',
        '}',
        '}',
        'fn g_() -> f32 {',
        '{',
        'return (data.scale * f_()[1]);',
        '}',
        '}',
      ].join('\n'),
    );
  });

  it.each([
    ['void f() { x = 1; }', "'x' is not known"],
    ['void f() { int a = g(1); }', "the function 'g' is not known"],
    ['sampler2D t;', "'sampler2D' is no type"],
    ['void f(inout int a) {}', "'inout'"],
    ['void f() { int a = 1 }', "';' is expected"],
    ['void f() {\n\nint a', 'line 3'],
    ['float f(vec2 v) { return float(v); }', 'float of vec2'],
  ])('refuses %s', (source, message) => {
    expect(() => translate(source, {})).toThrow(message);
  });

  it('understands every model that is here', () => {
    const constants = {
      GS_HALVES: 64,
      GS_FLOATS: 3,
      GS_WEIGHTS: 4,
      GS_HAS_RESIDUAL: true,
      GS_COLOR_ACTIVATION: 1,
      GS_RESIDUAL_ACTIVATION: 1,
      GS_EXPONENTIAL_BASE: true,
      GS_CLASSES: 16,
    };
    const data = new Parameters({
      base_scale: 'float',
      base_offset: 'float',
      camera_position: 'vec3',
      camera_forward: 'vec3',
      center_depth: 'float',
      count: 'int',
      num_residuals: 'int',
      mode: 'int',
      header_floats: 'float[3]',
      weights: 'vec4[4]',
    });
    const known = {
      ...data.known('data'),
      row: { code: 'row', type: 'int' },
      payload: { code: 'payload', type: 'uvec4', parameters: [{ type: 'int', isOut: false }] },
      payload_pair: { code: 'payload_pair', type: 'uvec2', parameters: [] },
    };
    for (const { packing, glsl } of models.values()) {
      for (const value of [0, 1, 3, 126]) {
        const own = Object.fromEntries(Object.keys(packing.constants ?? {}).map((name) => [name, value]));
        expect(translate(gaussian + colors + glsl, { ...constants, ...own }, known)).toContain('fn residual_(');
      }
    }
  });
});

describe('Parameters', () => {
  it('lies in memory as WGSL lays out storage', () => {
    const parameters = new Parameters({
      a: 'float',
      b: 'vec3',
      c: 'int',
      d: 'vec2',
      m: 'mat3',
      list: 'float[3]',
      quads: 'vec4[2]',
      is: 'bool',
    });
    parameters.set({
      a: 1,
      b: [2, 3, 4],
      c: -5,
      d: [6, 7],
      m: [1, 2, 3, 4, 5, 6, 7, 8, 9],
      list: [10, 11, 12],
      quads: [1, 2, 3, 4, 5, 6, 7, 8],
      is: true,
    });
    const floats = new Float32Array(parameters.bytes);
    const words = new Int32Array(parameters.bytes);
    expect([...floats.subarray(0, 7)]).toEqual([1, 0, 0, 0, 2, 3, 4]);
    expect(words[7]).toBe(-5);
    expect([...floats.subarray(8, 27)]).toEqual([6, 7, 0, 0, 1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9, 0, 10, 11, 12]);
    expect([...floats.subarray(28, 36)]).toEqual([1, 2, 3, 4, 5, 6, 7, 8]);
    expect(words[36]).toBe(1);
    expect(parameters.bytes.byteLength).toBe(160);
  });

  it('is declared in its order, and known by what it is there', () => {
    const parameters = new Parameters({ on: 'bool', m: 'mat3', list: 'float[3]' });
    expect(parameters.declaration('Data').replace(/\s+/g, ' ')).toBe(
      'struct Data { on: u32, m: mat3x3f, list: array<f32, (3)>, } ',
    );
    expect(parameters.known('data')).toEqual({
      on: { type: 'bool', code: '(data.on != 0u)' },
      m: { type: 'mat3', code: 'data.m' },
      list: { type: 'float[3]', code: 'data.list' },
    });
    expect(() => parameters.set({ other: 1 })).toThrow('no parameter is called other');
  });
});
