// SPDX-License-Identifier: Apache-2.0
// From GLSL to WGSL, in one pass over the text: functions, constants and variables, without what connects a shader to
// the page. README.md says which part of GLSL this is. Every name gets an underscore, so that none is a word of WGSL or
// stands for something else around it.

import type { Defines } from '../render/pass';
import {
  builtIn,
  componentOf,
  converted,
  elementOf,
  isMatrix,
  isType,
  sizeOf,
  vectorOf,
  wgslType,
  type Typed,
} from './glsl_types';
import { preprocess } from './preprocess';

/**
 * Something that the GLSL may call or read, and that stands elsewhere: of a function, `parameters` are the types that
 * it takes.
 */
export interface Known extends Typed {
  parameters?: { type: string; isOut: boolean }[];
}

/** A value, and how it is assigned to where that is not simply its code. */
interface Value extends Typed {
  /** More than one component of a vector, which WGSL cannot assign to. */
  components?: { of: string; names: string };
}

const TOKEN =
  /\s+|\/\/.*|\/\*[^]*?\*\/|((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?[uUfF]?|\w+|<<=|>>=|[-+*/%&|^=!<>]=|\+\+|--|<<|>>|&&|\|\||\S)/gy;
const BINARY = [
  ['||'],
  ['&&'],
  ['|'],
  ['^'],
  ['&'],
  ['==', '!='],
  ['<', '>', '<=', '>='],
  ['<<', '>>'],
  ['+', '-'],
  ['*', '/', '%'],
];
const LOGICAL = new Set(['||', '&&', '==', '!=', '<', '>', '<=', '>=']);
const ASSIGNMENTS = ['=', '+=', '-=', '*=', '/=', '%=', '&=', '|=', '^=', '<<=', '>>='];
const QUALIFIERS = ['const', 'in', 'highp', 'mediump', 'lowp'];
const COMPONENTS: Record<string, string> = { r: 'x', g: 'y', b: 'z', a: 'w', s: 'x', t: 'y', p: 'z', q: 'w' };

class Translator {
  private readonly tokens: { text: string; line: number }[] = [];
  private at = 0;
  /** What is known here, the innermost block last. */
  private readonly scopes: Map<string, Known>[];
  /** What follows the statement that is being read. */
  private behind: string[] | undefined;

  constructor(source: string, known: Record<string, Known>) {
    this.scopes = [new Map(Object.entries(known))];
    let line = 1;
    for (const [text, token] of source.matchAll(TOKEN)) {
      if (token) this.tokens.push({ text: token, line });
      line += text.split('\n').length - 1;
    }
  }

  private get next(): string {
    return this.tokens[this.at]?.text ?? '';
  }

  private fail(what: string): never {
    throw new Error(
      `line ${this.tokens[Math.min(this.at, this.tokens.length - 1)]?.line ?? 1} of the GLSL cannot be translated: ${what}`,
    );
  }

  private take(): string {
    if (this.at === this.tokens.length) this.fail('it ends too early');
    return this.tokens[this.at++].text;
  }
  private accept(text: string): boolean {
    return this.next === text && ++this.at > 0;
  }
  private expect(text: string): void {
    if (!this.accept(text)) this.fail(`'${text}' is expected in place of '${this.next}'`);
  }
  private name(): string {
    if (!/^[A-Za-z_]/.test(this.next)) this.fail(`a name is expected in place of '${this.next}'`);
    return this.take();
  }

  private find(name: string): Known {
    for (let i = this.scopes.length; i-- > 0;) {
      const found = this.scopes[i].get(name);
      if (found) return found;
    }
    return this.fail(`'${name}' is not known`);
  }
  private declare(name: string, known: Known): void {
    this.scopes.at(-1)!.set(name, known);
  }
  private inScope<T>(work: () => T): T {
    this.scopes.push(new Map());
    try {
      return work();
    } finally {
      this.scopes.pop();
    }
  }

  /** `[N]` behind a type or a name, of which there may be none. */
  private dimension(type: string): string {
    if (!this.accept('[')) return type;
    const size = this.expression().code;
    this.expect(']');
    return `${type}[${size}]`;
  }
  private type(): string {
    while (QUALIFIERS.includes(this.next)) this.take();
    if (!isType(this.next)) this.fail(`'${this.next}' is no type that is known`);
    return this.dimension(this.take());
  }

  // Expressions.

  private list(end: string): Value[] {
    const values: Value[] = [];
    while (!this.accept(end)) {
      if (values.length > 0) this.expect(',');
      values.push(this.expression());
    }
    return values;
  }

  private construct(type: string): Value {
    this.expect('(');
    const values = this.list(')');
    const size = sizeOf(type);
    // Arrays and matrices have no size in components.
    if (size === undefined) return { code: `${wgslType(type)}(${values.map(({ code }) => code).join(', ')})`, type };
    const component = componentOf(type);
    if (size === 1 && sizeOf(values[0].type) !== 1) this.fail(`${type} of ${values[0].type}`);
    if (size === 1) return { code: `${wgslType(type)}(${values[0].code})`, type };
    return { code: `${wgslType(type)}(${values.map((value) => converted(value, component)).join(', ')})`, type };
  }

  private call(name: string): Value {
    this.expect('(');
    const values = this.list(')');
    const known = this.scopes[0].get(name);
    if (!known?.parameters) return builtIn(name, values) ?? this.fail(`the function '${name}' is not known`);
    if (values.length !== known.parameters.length)
      this.fail(`'${name}' takes ${known.parameters.length} values, not ${values.length}`);
    const passed = values.map(({ code }, i) => (known.parameters![i].isOut ? `&${code}` : code));
    return { code: `${known.code}(${passed.join(', ')})`, type: known.type };
  }

  private primary(): Value {
    if (this.accept('(')) {
      const value = this.expression();
      this.expect(')');
      return { code: value.code, type: value.type }; // has brackets already where it needs them
    }
    if (/^[.\d]/.test(this.next)) {
      const text = this.take();
      const type = /[uU]$/.test(text) ? 'uint' : /[.eE]/.test(text) ? 'float' : 'int';
      return { code: type === 'uint' ? text.toLowerCase() : text.replace(/[fF]$/, ''), type };
    }
    if (this.next === 'true' || this.next === 'false') return { code: this.take(), type: 'bool' };
    if (isType(this.next)) return this.construct(this.type());
    const name = this.name();
    if (this.next === '(') return this.call(name);
    const { code, type } = this.find(name);
    return { code, type };
  }

  private postfix(): Value {
    let value = this.primary();
    for (;;) {
      if (this.accept('[')) {
        const index = this.expression().code;
        const element = elementOf(value.type) ?? this.fail(`${value.type} has no elements`);
        this.expect(']');
        value = { code: `${value.code}[${index}]`, type: element };
      } else if (this.accept('.')) {
        const names = [...this.name()].map((letter) => COMPONENTS[letter] ?? letter).join('');
        const type = vectorOf(componentOf(value.type), names.length);
        value = {
          code: `${value.code}.${names}`,
          type,
          ...(names.length > 1 ? { components: { of: value.code, names } } : {}),
        };
      } else if (this.next === '++' || this.next === '--') {
        if (!this.behind) this.fail(`'${this.next}' is understood in statements only`);
        this.behind.push(`${value.code} ${this.take()[0]}= 1;`);
      } else return value;
    }
  }

  private unary(): Value {
    if (!['-', '+', '!', '~'].includes(this.next)) return this.postfix();
    const operator = this.take();
    const { code, type } = this.unary();
    return operator === '+' ? { code, type } : { code: `(${operator}${code})`, type };
  }

  private binary(level = 0): Value {
    if (level === BINARY.length) return this.unary();
    let left = this.binary(level + 1);
    while (BINARY[level].includes(this.next)) left = this.combined(left, this.take(), this.binary(level + 1));
    return left;
  }

  private combined(left: Value, operator: string, right: Value): Value {
    // WGSL has the same operators on scalars, vectors and matrices, but shifts by unsigned numbers only, and wants
    // brackets in mixtures.
    const by = operator === '<<' || operator === '>>' ? converted(right, 'uint') : right.code;
    return {
      code: `(${left.code} ${operator} ${by})`,
      type: LOGICAL.has(operator) ? 'bool' : resultOf(left.type, right.type, operator),
    };
  }

  private expression(): Value {
    const condition = this.binary();
    if (!this.accept('?')) return condition;
    const yes = this.expression();
    this.expect(':');
    const no = this.expression();
    // Both are computed: no expression here does more than that.
    return { code: `select(${no.code}, ${yes.code}, ${condition.code})`, type: yes.type };
  }

  // Statements.

  private assignment(): string {
    if (this.next === '++' || this.next === '--') {
      const operator = this.take()[0];
      return `${this.postfix().code} ${operator}= 1`;
    }
    const to = this.postfix();
    if (!ASSIGNMENTS.includes(this.next)) {
      if (this.behind?.length) return this.behind.pop()!.slice(0, -1); // i++ by itself
      return to.code;
    }
    const operator = this.take();
    const value = this.expression();
    const isShift = operator === '<<=' || operator === '>>=';
    if (!to.components) return `${to.code} ${operator} ${isShift ? converted(value, 'uint') : value.code}`;
    const { of, names } = to.components;
    const all = operator === '=' ? value.code : this.combined(to, operator.slice(0, -1), value).code;
    return `{ let parts = ${all}; ${[...names].map((name, i) => `${of}.${name} = parts.${'xyzw'[i]};`).join(' ')} }`;
  }

  /** Variables behind their type; `how` is what WGSL says in front of one. */
  private variables(type: string, how: string): string {
    const all: string[] = [];
    do {
      const name = this.name();
      const whole = this.dimension(type);
      const value = this.accept('=') ? ` = ${this.expression().code}` : '';
      this.declare(name, { code: `${name}_`, type: whole });
      all.push(`${how} ${name}_: ${wgslType(whole)}${value};`);
    } while (this.accept(','));
    return all.join(' ');
  }

  private get isDeclaration(): boolean {
    return (
      QUALIFIERS.includes(this.next) || (isType(this.next) && /^[A-Za-z_]/.test(this.tokens[this.at + 1]?.text ?? ''))
    );
  }

  private simple(): string {
    if (!this.isDeclaration) return `${this.assignment()};`;
    const how = this.next === 'const' ? 'let' : 'var';
    return this.variables(this.type(), how);
  }

  /** A statement that other ones may follow, and what comes behind it. */
  private finished(): string {
    this.behind = [];
    const code = this.simple();
    const all = [code, ...this.behind].join(' ');
    this.behind = undefined;
    this.expect(';');
    return all;
  }

  private block(): string {
    return this.inScope(() => {
      if (!this.accept('{')) return `{ ${this.statement()} }`;
      const all: string[] = [];
      while (!this.accept('}')) all.push(this.statement());
      return `{\n${all.join('\n')}\n}`;
    });
  }

  private condition(): string {
    this.expect('(');
    const { code } = this.expression();
    this.expect(')');
    return code;
  }

  private statement(): string {
    if (this.next === '{') return this.block();
    if (this.accept(';')) return '';
    if (this.accept('if')) {
      const condition = this.condition();
      const yes = this.block();
      return `if (${condition}) ${yes}${this.accept('else') ? ` else ${this.block()}` : ''}`;
    }
    if (this.accept('while')) return `while (${this.condition()}) ${this.block()}`;
    if (this.accept('for')) return this.loop();
    if (this.accept('return')) {
      const value = this.next === ';' ? '' : ` ${this.expression().code}`;
      this.expect(';');
      return `return${value};`;
    }
    if (['break', 'continue', 'discard'].includes(this.next)) {
      const word = this.take();
      this.expect(';');
      return `${word};`;
    }
    return this.finished();
  }

  private loop(): string {
    return this.inScope(() => {
      this.expect('(');
      const begin = this.accept(';') ? '' : this.finished();
      const condition = this.next === ';' ? '' : this.expression().code;
      this.expect(';');
      this.behind = [];
      const step = this.next === ')' ? '' : this.assignment();
      this.behind = undefined;
      this.expect(')');
      // In front of the loop, as there may be several variables.
      return `{ ${begin} for (; ${condition}; ${step}) ${this.block()} }`;
    });
  }

  private function(type: string, name: string): string {
    const parameters: { type: string; isOut: boolean; name: string }[] = [];
    while (!this.accept(')')) {
      if (parameters.length > 0) this.expect(',');
      if (this.next === 'inout') this.fail("'inout'");
      const isOut = this.accept('out');
      const base = this.type();
      const parameter = this.name();
      parameters.push({ type: this.dimension(base), isOut, name: parameter });
    }
    this.declare(name, { code: `${name}_`, type, parameters });
    if (this.accept(';')) return ''; // is defined elsewhere
    const head = parameters
      .map((one) => `${one.name}_in: ${one.isOut ? `ptr<function, ${wgslType(one.type)}>` : wgslType(one.type)}`)
      .join(', ');
    return this.inScope(() => {
      for (const one of parameters)
        this.declare(one.name, { code: one.isOut ? `(*${one.name}_in)` : `${one.name}_`, type: one.type });
      // GLSL may write to its parameters, and index those that are arrays.
      const copies = parameters.filter((one) => !one.isOut).map((one) => `var ${one.name}_ = ${one.name}_in;`);
      return `fn ${name}_(${head})${type === 'void' ? '' : ` -> ${wgslType(type)}`} {\n${[...copies, this.block()].join('\n')}\n}`;
    });
  }

  program(): string {
    const all: string[] = [];
    while (this.at < this.tokens.length) {
      const isConstant = this.next === 'const';
      const type = this.type();
      if (this.tokens[this.at + 1]?.text === '(') {
        const name = this.name();
        this.expect('(');
        all.push(this.function(type, name));
      } else {
        all.push(this.variables(type, isConstant ? 'const' : 'var<private>'));
        this.expect(';');
      }
    }
    return all.filter(Boolean).join('\n');
  }
}

function resultOf(left: string, right: string, operator: string): string {
  if (operator === '*' && isMatrix(left)) return isMatrix(right) || sizeOf(right) === 1 ? left : right;
  if (isMatrix(right) && operator === '*') return sizeOf(left) === 1 ? right : left;
  return (sizeOf(right) ?? 0) > (sizeOf(left) ?? 0) ? right : left;
}

/**
 * WGSL of the same functions, constants and variables. `known` is what the GLSL uses of others. Throws Error saying
 * which line is not understood.
 */
export function translate(glsl: string, defines: Defines, known: Record<string, Known> = {}): string {
  return new Translator(preprocess(glsl, defines), known).program();
}
