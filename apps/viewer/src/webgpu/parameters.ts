// SPDX-License-Identifier: Apache-2.0
// Numbers that a shader takes from the page: their struct in WGSL, and their bytes as that lays them out in a storage
// buffer.

import { elementOf, isMatrix, sizeOf, wgslType } from './glsl_types';
import type { Known } from './translate';

type Value = number | boolean | ArrayLike<number>;

interface Field {
  type: string;
  /** In words of four bytes. */
  at: number;
  /** What is copied at once, and from one of those to the next. */
  words: number;
  stride: number;
}

/** Words of a scalar or vector, and of what it is aligned to. */
function layoutOf(type: string): { words: number; alignment: number } {
  const words = isMatrix(type) ? Number(type.at(-1)) : sizeOf(type)!;
  return { words, alignment: words === 3 ? 4 : words };
}

export class Parameters {
  readonly bytes: ArrayBuffer;
  private readonly fields = new Map<string, Field>();

  /** Types are those of GLSL: scalars, vectors, square matrices, and arrays of scalars or vectors. */
  constructor(types: Record<string, string>) {
    let end = 0;
    for (const [name, type] of Object.entries(types)) {
      const isArray = type.endsWith(']');
      const { words, alignment } = layoutOf(isArray ? elementOf(type)! : type);
      const at = Math.ceil(end / alignment) * alignment;
      const stride = Math.ceil(words / alignment) * alignment;
      const count = isArray ? Number(/\[(\d+)\]$/.exec(type)![1]) : isMatrix(type) ? words : 1;
      this.fields.set(name, { type, at, words, stride });
      end = at + (isArray || isMatrix(type) ? count * stride : words);
    }
    this.bytes = new ArrayBuffer(16 * Math.ceil(end / 4));
  }

  /** The declaration of the struct. Truth values are numbers there: those can lie in memory. */
  declaration(name: string): string {
    return `struct ${name} {\n${[...this.fields].map(([field, { type }]) => `    ${field}: ${type === 'bool' ? 'u32' : wgslType(type)},\n`).join('')}}\n`;
  }

  /** What GLSL calls by the fields' names, in a variable of that struct. */
  known(variable: string): Record<string, Known> {
    return Object.fromEntries(
      [...this.fields].map(([name, { type }]) => [
        name,
        { type, code: type === 'bool' ? `(${variable}.${name} != 0u)` : `${variable}.${name}` },
      ]),
    );
  }

  set(values: Record<string, Value>): void {
    for (const [name, value] of Object.entries(values)) {
      const field = this.fields.get(name);
      if (!field) throw new Error(`no parameter is called ${name}`);
      const { type, at, words, stride } = field;
      const numbers = typeof value === 'object' ? value : [Number(value)];
      const array = /^(int|ivec|uint|uvec|bool)/.test(type) ? new Int32Array(this.bytes) : new Float32Array(this.bytes);
      for (let i = 0; i < numbers.length; ++i) array[at + stride * Math.floor(i / words) + (i % words)] = numbers[i];
    }
  }
}
