// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { parseSite } from '../src/compare/site';

const first = { file: 'scene.ngsplat', name: 'a' };
const second = { file: 'scene-2.ngsplat', name: 'b' };
const site = (changes: object = {}) =>
  JSON.stringify({
    version: 1,
    generator: 'gsapp',
    models: [first, second],
    photographs: ['photographs/00000.png', null],
    ...changes,
  });

describe('parseSite', () => {
  it('takes what gsapp export writes', () => {
    expect(parseSite(site(), 2)).toEqual({
      name: 'a',
      other: second,
      photographs: ['photographs/00000.png', undefined],
    });
    expect(parseSite(JSON.stringify({ version: 1, models: [first] }), 2)).toEqual({ name: 'a', other: undefined });
  });

  it('takes levels', () => {
    const levels = [
      { file: 'scene.ngsplat', num_gaussians: 9000, bytes: 200, psnr: 30.5 },
      { file: 'scene-level-1.ngsplat', num_gaussians: 4500, bytes: 100 },
    ];
    expect(parseSite(site({ levels }), 2).levels).toEqual([
      { file: 'scene.ngsplat', count: 9000, bytes: 200, psnr: 30.5 },
      { file: 'scene-level-1.ngsplat', count: 4500, bytes: 100, psnr: undefined },
    ]);
    const changed = (changes: object) => () =>
      parseSite(site({ levels: [levels[0], { ...levels[1], ...changes }] }), 2);
    expect(changed({ file: '../a.ngsplat' })).toThrow('no .ngsplat file of this site');
    expect(changed({ bytes: -1 })).toThrow('lacks its Gaussians or its bytes');
    expect(changed({ num_gaussians: '4500' })).toThrow('lacks its Gaussians or its bytes');
    expect(changed({ num_gaussians: 9000 })).toThrow('do not become coarser');
    expect(changed({ psnr: 'high' })().levels![1].psnr).toBeUndefined();
    for (const list of [[], {}, null, 'a', Array(17).fill(levels[0])])
      expect(() => parseSite(site({ levels: list }), 2)).toThrow('no list of some');
    expect(() => parseSite(site({ levels: [levels[1], levels[0]] }), 2)).toThrow(
      'its first level is scene-level-1.ngsplat',
    );
    expect(() => parseSite(site({ levels: [levels[0], null] }), 2)).toThrow('no .ngsplat file of this site');
  });

  it('shortens names', () => {
    expect(parseSite(site({ models: [{ ...first, name: 'x'.repeat(1000) }] }), 2).name.length).toBe(200);
  });

  it.each([
    ['no JSON', site().slice(1), 'not JSON'],
    ['null', 'null', 'version'],
    ['a list', '[]', 'version'],
    ['a newer version', site({ version: 2 }), 'version 2'],
    ['no models', site({ models: [] }), 'neither one model nor two'],
    ['three models', site({ models: [first, second, second] }), 'neither one model nor two'],
    ['a model that is null', site({ models: [first, null] }), 'no .ngsplat file'],
    ['a model without a name', site({ models: [first, { file: 'b.ngsplat' }] }), 'has no name'],
    ['another first model', site({ models: [second, first] }), 'not scene.ngsplat'],
    ['the same model twice', site({ models: [first, first] }), 'the same'],
    ['too few photographs', site({ photographs: [] }), 'list of 2 photographs'],
    ['photographs that are no list', site({ photographs: {} }), 'list of 2 photographs'],
  ])('refuses %s', (_, text, words) => {
    expect(() => parseSite(text, 2)).toThrow(words);
  });

  it.each([
    'https://example.com/a',
    '//example.com/a',
    '/a',
    '../a',
    'b/../a',
    './a',
    'b/./a',
    '.a',
    'b/',
    'a?x=',
    'a#',
    'a%2e',
    'a\\b',
    'data:a',
    'a b',
    '',
  ])('asks nothing but its own site for %s', (path) => {
    expect(() => parseSite(site({ models: [first, { file: `${path}.ngsplat`, name: 'b' }] }), 2)).toThrow(
      'no .ngsplat file of this site',
    );
    expect(() => parseSite(site({ photographs: [`${path}.png`, null] }), 2)).toThrow('no picture of this site');
  });
});
