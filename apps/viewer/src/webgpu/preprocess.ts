// SPDX-License-Identifier: Apache-2.0
// The part of GLSL's preprocessor that shaders here use: #if, #elif, #else and #endif on constants, and the constants
// themselves.

import { evaluate } from '../format/expression';
import type { Defines } from '../render/pass';

/** Conditions of nested #ifs: whether this branch is taken, and whether any was. */
interface Branch {
  isTaken: boolean;
  wasTaken: boolean;
}

/**
 * The lines that `defines` select, with its values in place of its names; other lines are left empty. Throws Error
 * where one is not understood.
 */
export function preprocess(source: string, defines: Defines): string {
  const values = Object.fromEntries(Object.entries(defines).map(([name, value]) => [name, Number(value)]));
  const branches: Branch[] = [];
  const isTaken = () => branches.every((branch) => branch.isTaken);
  const lines = source.split('\n').map((line) => {
    const [, word, rest] = /^\s*#\s*(\w+)\s*(.*?)\s*(?:\/\/.*)?$/.exec(line) ?? [];
    const branch = branches.at(-1);
    if (word === undefined)
      return isTaken()
        ? line.replace(/\b[A-Za-z_]\w*\b/g, (name) => (Object.hasOwn(values, name) ? String(values[name]) : name))
        : '';
    if (word === 'if') {
      const condition = isTaken() && evaluate(rest, values) !== 0;
      branches.push({ isTaken: condition, wasTaken: condition });
    } else if (branch && (word === 'elif' || word === 'else')) {
      const outer = branches.slice(0, -1).every((one) => one.isTaken);
      branch.isTaken = outer && !branch.wasTaken && (word === 'else' || evaluate(rest, values) !== 0);
      branch.wasTaken ||= branch.isTaken;
    } else if (branch && word === 'endif') branches.pop();
    else throw new Error(`the line '${line.trim()}' cannot be translated`);
    return '';
  });
  if (branches.length > 0) throw new Error('an #if has no #endif');
  return lines.join('\n');
}
