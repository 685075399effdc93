// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { formatAddress, hexColor, parseAddress, type Address, type AddressCamera } from '../src/address';
import { DEFAULTS } from '../src/settings';

describe('the address', () => {
  it('is empty at the beginning, and read as such', () => {
    expect(formatAddress({ settings: DEFAULTS }, 1)).toBe('');
    for (const empty of ['', '#'])
      expect(parseAddress(empty)).toEqual({ settings: DEFAULTS, camera: undefined, compared: undefined });
  });

  it('keeps everything, in text that people can read', () => {
    const address: Address = {
      camera: { from: [1.25, -2, 1e-3], to: [0, 0, 10000], fov: 47.5 },
      settings: {
        mode: 'depth',
        photometric: false,
        movement: 'fly',
        up: '-z',
        background: [1, 0.6, 0],
        splatSize: 0.5,
        points: true,
        near: 1.5,
        detail: 2,
        panel: true,
      },
      compared: { left: 'base', right: 'photograph', split: 0.25 },
    };
    const text = formatAddress(address, 4);
    expect(text).toBe(
      'from=1.25,-2,0.001&to=0,0,10000&fov=47.5&mode=depth&exposure=off&move=fly&up=-z&background=ff9900&size=0.5&points=on&near=1.5&detail=2&panel=open&compare=base,photograph&split=25',
    );
    expect(parseAddress(`#${text}`)).toEqual(address);
    expect(parseAddress('#panel=closed').settings.panel).toBe(false);
    expect(parseAddress('#view=3').camera).toEqual({ view: 2 });
    expect(formatAddress({ settings: DEFAULTS, camera: { view: 2 } }, 4)).toBe('view=3');
  });

  it('says what is compared, and where the divider is unless it is in the middle', () => {
    const text = (split: number) =>
      formatAddress({ settings: DEFAULTS, compared: { left: 'full', right: 'other', split } }, 1);
    expect([0, 1 / 3, 0.5, 0.50001, 0.89, 1].map(text)).toEqual(
      ['&split=0', '&split=33.3', '', '', '&split=89', '&split=100'].map((split) => `compare=full,other${split}`),
    );
    expect(parseAddress('#compare=depth,full').compared).toEqual({ left: 'depth', right: 'full', split: 0.5 });
    expect(parseAddress('#split=12.5&compare=depth,depth').compared).toEqual({
      left: 'depth',
      right: 'depth',
      split: 0.125,
    });
    for (const split of ['', '-1', '101', 'NaN', 'half', '1,2'])
      expect(parseAddress(`#compare=depth,full&split=${split}`).compared, split).toEqual({
        left: 'depth',
        right: 'full',
        split: 0.5,
      });
    for (const sides of [
      '',
      ',',
      'full',
      'full,',
      'full,wrong',
      'full,base,depth',
      'toString,full',
      'Full,Base',
      ' full,base',
    ])
      expect(parseAddress(`#compare=${sides}&split=20`).compared, sides).toBeUndefined();
    expect(parseAddress('#split=20').compared).toBeUndefined();
  });

  it('rounds, more finely where the scene is small', () => {
    const camera: AddressCamera = { from: [1 / 3, -1e-9, 1234.56789], to: [0, 0, 0] };
    const text = (size: number) => formatAddress({ settings: DEFAULTS, camera }, size);
    expect(text(4)).toBe('from=0.33333,0,1234.56789&to=0,0,0');
    expect(text(4000)).toBe('from=0.33,0,1234.57&to=0,0,0');
    expect(text(0.004)).toBe('from=0.33333333,0,1234.56789&to=0,0,0');
    for (const size of [0, 1e-30, 1e30]) expect(text(size)).toMatch(/^from=0/);
  });

  it('drops nonsense part by part', () => {
    const { camera, settings } = parseAddress(
      '#from=1,2,3&to=4,5,6&fov=nan&mode=wrong&background=red&size=99&near=-1&detail=1.5&points=maybe&view=0&up=w&panel=ajar&%E0%A4%A=1&move=fly',
    );
    expect(camera).toEqual({ from: [1, 2, 3], to: [4, 5, 6], fov: undefined });
    expect(settings).toEqual({ ...DEFAULTS, movement: 'fly' });
    for (const pose of [
      'from=1,2&to=0,0,0',
      'from=1,2,3',
      'from=1,,3&to=0,0,0',
      'from=1,2,3&to=1,2,3',
      'from=1,2,Infinity&to=0,0,0',
      'from=1e99,0,0&to=0,0,0',
      'view=1.5',
      'view=',
    ])
      expect(parseAddress(pose).camera, pose).toBeUndefined();
  });

  it('writes colours within their bounds', () => {
    expect(hexColor([-1, 0.5, 7])).toBe('0080ff');
  });
});
