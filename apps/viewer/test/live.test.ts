// SPDX-License-Identifier: Apache-2.0
import { expect, test } from 'vitest';
import { polyline } from '../src/live/chart';

const points = (text: string) => text.split(' ').map((point) => point.split(',').map(Number));

test('a curve goes from the left edge to the right, and from its least to its largest value', () => {
  const drawn = points(polyline({ iterations: [100, 200, 400], values: [3, 1, 2] }));
  expect(drawn).toEqual([[0, 0], [33.33, 30], [100, 15]]);
});

test('values that are not known are left out, and a constant lies in the middle', () => {
  expect(points(polyline({ iterations: [1, 2, 3], values: [5, null, 5] }))).toEqual([[0, 15], [100, 15]]);
});

test('one value is no curve', () => {
  expect(polyline({ iterations: [7], values: [1] })).toBe('');
  expect(polyline({ iterations: [], values: [] })).toBe('');
});
