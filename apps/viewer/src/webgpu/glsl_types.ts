// SPDX-License-Identifier: Apache-2.0
// Types of GLSL by their names there, arrays as 'float[8]', and what built-in functions return.

const SCALARS: Record<string, string> = { float: 'f32', int: 'i32', uint: 'u32', bool: 'bool' };
const LETTERS: Record<string, string> = { float: '', int: 'i', uint: 'u', bool: 'b' };
const WGSL_LETTERS: Record<string, string> = { float: 'f', int: 'i', uint: 'u' };

/** The number of components, 1 of a scalar; undefined for other types. */
export function sizeOf(type: string): number | undefined {
  return type in SCALARS ? 1 : /^[iub]?vec[234]$/.test(type) ? Number(type.at(-1)) : undefined;
}

/** What a vector is made of; a scalar itself. */
export function componentOf(type: string): string {
  if (type in SCALARS) return type;
  return { v: 'float', i: 'int', u: 'uint', b: 'bool' }[type[0]]!;
}

export function vectorOf(component: string, size: number): string {
  return size === 1 ? component : `${LETTERS[component]}vec${size}`;
}

export const isMatrix = (type: string): boolean => /^mat[234]$/.test(type);
export const isType = (name: string): boolean => sizeOf(name) !== undefined || isMatrix(name) || name === 'void';

/** What an index gives; undefined where there is none. */
export function elementOf(type: string): string | undefined {
  const array = /^(.*?)\[.*\]$/.exec(type);
  if (array) return array[1];
  if (isMatrix(type)) return `vec${type.at(-1)}`;
  return (sizeOf(type) ?? 1) > 1 ? componentOf(type) : undefined;
}

export function wgslType(type: string): string {
  const array = /^(.*?)\[(.*)\]$/.exec(type);
  if (array) return `array<${wgslType(array[1])}, (${array[2]})>`;
  if (isMatrix(type)) return `mat${type.at(-1)}x${type.at(-1)}f`;
  if (type in SCALARS) return SCALARS[type];
  const component = componentOf(type);
  const size = type.at(-1);
  return component === 'bool' ? `vec${size}<bool>` : `vec${size}${WGSL_LETTERS[component]}`;
}

/** The same names in both languages, for all numbers of components: the result is of the widest argument's type. */
const COMPONENTWISE = new Set([
  'abs',
  'sign',
  'floor',
  'ceil',
  'fract',
  'trunc',
  'round',
  'sqrt',
  'exp',
  'exp2',
  'log',
  'log2',
  'sin',
  'cos',
  'tan',
  'asin',
  'acos',
  'atan',
  'sinh',
  'cosh',
  'tanh',
  'radians',
  'degrees',
  'normalize',
  'min',
  'max',
  'clamp',
  'mix',
  'step',
  'smoothstep',
  'pow',
  'cross',
  'reflect',
]);
const SCALAR_RESULTS = new Set(['dot', 'length', 'distance']);
const COMPARISONS: Record<string, string> = {
  equal: '==',
  notEqual: '!=',
  lessThan: '<',
  lessThanEqual: '<=',
  greaterThan: '>',
  greaterThanEqual: '>=',
};
const OTHERS: Record<string, { name: string; result: string }> = {
  unpackHalf2x16: { name: 'unpack2x16float', result: 'vec2' },
  packHalf2x16: { name: 'pack2x16float', result: 'uint' },
  floatBitsToUint: { name: 'bitcast<u32>', result: 'uint' },
  floatBitsToInt: { name: 'bitcast<i32>', result: 'int' },
  uintBitsToFloat: { name: 'bitcast<f32>', result: 'float' },
  intBitsToFloat: { name: 'bitcast<f32>', result: 'float' },
  any: { name: 'any', result: 'bool' },
  all: { name: 'all', result: 'bool' },
};

/** A piece of WGSL and the type of its value. */
export interface Typed {
  code: string;
  type: string;
}

/** `value` made of components of another type. */
export function converted({ code, type }: Typed, component: string): string {
  if (componentOf(type) === component) return code;
  return `${wgslType(vectorOf(component, sizeOf(type)!))}(${code})`;
}

/** A call of a built-in function; undefined where there is none of this name. */
export function builtIn(name: string, values: Typed[]): Typed | undefined {
  const list = values.map(({ code }) => code).join(', ');
  const { type: first } = values[0] ?? { type: 'void' };
  if (name in OTHERS) return { code: `${OTHERS[name].name}(${list})`, type: OTHERS[name].result };
  if (name in COMPARISONS)
    return {
      code: `(${values[0].code} ${COMPARISONS[name]} ${values[1].code})`,
      type: vectorOf('bool', sizeOf(first)!),
    };
  if (SCALAR_RESULTS.has(name)) return { code: `${name}(${list})`, type: 'float' };
  if (name === 'inversesqrt') return { code: `inverseSqrt(${list})`, type: first };
  if (name === 'mod')
    return {
      code: `(${values[0].code} - ${values[1].code} * floor(${values[0].code} / ${values[1].code}))`,
      type: first,
    };
  if (name === 'mix' && componentOf(values[2].type) === 'bool') return { code: `select(${list})`, type: first };
  if (!COMPONENTWISE.has(name)) return undefined;
  const type = values.reduce((widest, value) => (sizeOf(value.type)! > sizeOf(widest)! ? value.type : widest), first);
  // WGSL wants all arguments of one size.
  const same = values.map((value) =>
    value.type === type || sizeOf(type) === 1 ? value.code : `${wgslType(type)}(${value.code})`,
  );
  return { code: `${name === 'atan' && values.length === 2 ? 'atan2' : name}(${same.join(', ')})`, type };
}
