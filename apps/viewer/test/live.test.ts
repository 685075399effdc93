// SPDX-License-Identifier: Apache-2.0
import { expect, test } from 'vitest';
import { polyline } from '../src/live/chart';
import { facts, lostText } from '../src/live/live_panel';
import type { Status } from '../src/live/status';

const points = (text: string) => text.split(' ').map((point) => point.split(',').map(Number));

test('a curve goes from the left edge to the right, and from its least to its largest value', () => {
  const drawn = points(polyline({ iterations: [100, 200, 400], values: [3, 1, 2] }));
  expect(drawn).toEqual([
    [0, 0],
    [33.33, 30],
    [100, 15],
  ]);
});

test('values that are not known are left out, and a constant lies in the middle', () => {
  expect(points(polyline({ iterations: [1, 2, 3], values: [5, null, 5] }))).toEqual([
    [0, 15],
    [100, 15],
  ]);
});

test('one value is no curve', () => {
  expect(polyline({ iterations: [7], values: [1] })).toBe('');
  expect(polyline({ iterations: [], values: [] })).toBe('');
});

const status: Status = {
  id: 'a',
  scene: 'lego',
  appearance: 'sh',
  run: 'run',
  state: 'training',
  controls: true,
  iteration: 900,
  num_gaussians: 5000,
  train_seconds: 7,
  save_pending: false,
  model: { version: 3, iteration: 800, url: 'live/model-3.ngsplat' },
  photographs: 0,
  loss_curve: { iterations: [], values: [] },
  psnr_curve: { iterations: [], values: [] },
  psnr_of: '',
};

test('the facts say of which iteration the picture on the page is, not the one that gsapp has', () => {
  expect(facts(status, 700)).toContainEqual(['Picture of iteration', '700']);
  expect(facts(status, undefined).map(([name]) => name)).not.toContain('Picture of iteration');
});

test('when gsapp answers no more, the page still says how the training ended, or that it must have', () => {
  expect(lostText(undefined, 1)).toBe('gsapp does not answer any more.');
  expect(lostText({ ...status, state: 'finished' }, 1)).toBe(
    'Finished after 900 iterations. gsapp view run shows what it saved.',
  );
  expect(lostText({ ...status, state: 'failed', message: 'no memory' }, 1)).toBe(
    'Failed: no memory. gsapp view run shows what it saved.',
  );
  expect(lostText({ ...status, eta_seconds: 60 }, 59)).toBe(
    'gsapp does not answer any more. gsapp view run shows what it saved.',
  );
  expect(lostText({ ...status, eta_seconds: 60 }, 61)).toBe(
    'gsapp has ended; by its last estimate, the training has finished. gsapp view run shows what it saved.',
  );
});
