// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { finestThatFits, type Level } from '../src/levels/levels';
import { memoryOf } from '../src/levels/memory';
import { Pace } from '../src/levels/pace';
import { Meter } from '../src/ui/meter';

/** How many frames of so many milliseconds it takes until the pace says something, and what; at most `most`. */
function run(pace: Pace, milliseconds: number, most = 10_000): [number, string | undefined] {
  for (let i = 1; i <= most; ++i) {
    const said = pace.frame(milliseconds);
    if (said) return [i, said];
  }
  return [most, undefined];
}

describe('the pace', () => {
  it('asks for a coarser level after two seconds of slow frames', () => {
    expect(run(new Pace(), 100)).toEqual([20, 'coarser']);
    expect(run(new Pace(), 51)).toEqual([40, 'coarser']);
  });

  it('is not misled by one long pause', () => {
    expect(run(new Pace(), 1e9, 3)).toEqual([3, undefined]);
    const pace = new Pace();
    for (let i = 0; i < 100; ++i) {
      expect(pace.frame(400)).toBeUndefined(); // a hiccup among fast frames
      for (let k = 0; k < 28; ++k) expect(pace.frame(16)).toBeUndefined();
    }
  });

  it('leaves what is neither slow nor fast', () => {
    expect(run(new Pace(), 40)).toEqual([10_000, undefined]);
  });

  it('asks for a finer level where there is room, more and more rarely after it was too slow', () => {
    const pace = new Pace();
    expect(run(pace, 10)).toEqual([300, 'finer']);
    expect(run(pace, 100)).toEqual([20, 'coarser']);
    expect(run(pace, 10)).toEqual([600, 'finer']);
    expect(run(pace, 100)).toEqual([20, 'coarser']);
    expect(run(pace, 10)).toEqual([1200, 'finer']);
  });

  it('begins anew with another level', () => {
    const pace = new Pace();
    run(pace, 100, 19);
    pace.begin();
    expect(run(pace, 100, 19)).toEqual([19, undefined]);
  });
});

describe('the memory', () => {
  const levels: Level[] = [4000, 2000, 1000].map((count, k) => ({ file: `${k}`, count, bytes: 56 * count }));

  it('decides about the finest level', () => {
    const need = levels.map(({ bytes, count }) => memoryOf(bytes, count));
    expect(need[0]).toBeGreaterThan(levels[0].bytes);
    expect(finestThatFits(levels, Infinity)).toBe(0);
    expect(finestThatFits(levels, need[0])).toBe(0);
    expect(finestThatFits(levels, need[0] - 1)).toBe(1);
    expect(finestThatFits(levels, need[2])).toBe(2);
    expect(finestThatFits(levels, 0)).toBe(2);
  });
});

describe('the meter', () => {
  it('says that it is sorting until there is an order', () => {
    const output = { textContent: '' } as HTMLElement;
    const meter = new Meter(output);
    meter.frame(0, undefined, 0);
    expect(output.textContent).toBe('sorting…');
    meter.frame(10, 0, 0);
    expect(output.textContent).toBe('0 drawn · sorted in 0 ms');
    meter.frame(20, 12.4, 3456);
    expect(output.textContent).toBe('3,456 drawn · sorted in 12 ms');
  });
});
