// SPDX-License-Identifier: Apache-2.0
// Arithmetic in text: what a model's packing.json says about sizes. The grammar is that of appearance/packing.h.

export type Values = Readonly<Record<string, number>>;

/** Binary operators by how tightly they bind. */
const OPERATORS = [['||'], ['&&'], ['==', '!=', '<=', '>=', '<', '>'], ['+', '-'], ['*', '/', '%']];

const APPLY: Record<string, (a: number, b: number) => number> = {
  '||': (a, b) => Number(a !== 0 || b !== 0),
  '&&': (a, b) => Number(a !== 0 && b !== 0),
  '==': (a, b) => Number(a === b),
  '!=': (a, b) => Number(a !== b),
  '<=': (a, b) => Number(a <= b),
  '>=': (a, b) => Number(a >= b),
  '<': (a, b) => Number(a < b),
  '>': (a, b) => Number(a > b),
  '+': (a, b) => a + b,
  '-': (a, b) => a - b,
  '*': (a, b) => a * b,
  '/': (a, b) => Math.floor(a / b),
  '%': (a, b) => a - b * Math.floor(a / b),
};

/** The value of an expression of whole numbers and the names of `values`. Throws Error where it is none. */
export function evaluate(text: string, values: Values): number {
  const tokens = text.match(/\w+|[|&=!<>]{2}|[^\s\w]/g) ?? [];
  let at = 0;
  const fail = (): never => {
    throw new Error(`the expression '${text}' cannot be understood at '${tokens[at] ?? 'its end'}'`);
  };
  const take = (token: string): boolean => tokens[at] === token && ++at > 0;

  function choice(): number {
    const condition = binary(0);
    if (!take('?')) return condition;
    const yes = choice();
    if (!take(':')) fail();
    const no = choice();
    return condition !== 0 ? yes : no;
  }
  function binary(level: number): number {
    if (level === OPERATORS.length) return unary();
    let value = binary(level + 1);
    for (;;) {
      const operator = OPERATORS[level].find(take);
      if (operator === undefined) return value;
      value = APPLY[operator](value, binary(level + 1));
    }
  }
  function unary(): number {
    if (take('!')) return Number(unary() === 0);
    if (take('(')) {
      const value = choice();
      if (!take(')')) fail();
      return value;
    }
    const token = tokens[at] ?? '';
    if (/^\d{1,15}$/.test(token)) return (++at, Number(token));
    if (!Object.hasOwn(values, token)) fail();
    return (++at, values[token]);
  }

  const value = choice();
  if (at < tokens.length) fail();
  return value;
}
