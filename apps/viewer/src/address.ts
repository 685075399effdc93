// SPDX-License-Identifier: Apache-2.0
// The fragment of the page's address: the camera and the settings as key=value pairs, so that a link shows the same
// picture.

import { AXES, type AxisName, type MovementName } from './camera/navigator';
import { LARGEST_NUMBER } from './format/cursor';
import type { Vector } from './format/vector';
import { MODES, type Mode } from './render/prepass';
import { DEFAULTS, SPLAT_SIZES, type Settings } from './settings';
import { MIDDLE, SHOWN, type Compared } from './ui/compare';

/** A test view by its index, or a pose: from where, to what point, and the vertical field of view in degrees. */
export type AddressCamera = { view: number } | { from: Vector; to: Vector; fov?: number };

export interface Address {
  settings: Settings;
  /** Undefined: the first view. */
  camera?: AddressCamera;
  /** Undefined: one picture. */
  compared?: Compared;
}

const LARGEST_FOV = 175;
const PANEL = ['open', 'closed'] as const;
/** More levels than any model has. */
const MOST_DETAIL = 99;

const short = (x: number): string => String(Number(x.toPrecision(5)));
const percent = (x: number): string => String(Number((100 * x).toFixed(1)));
const byte = (x: number): string =>
  Math.round(255 * Math.min(1, Math.max(0, x)))
    .toString(16)
    .padStart(2, '0');

/** RRGGBB in hexadecimal digits. */
export const hexColor = (color: Vector): string => color.map(byte).join('');

/** Undefined where the text is not RRGGBB. */
export function colorOf(hex: string): Vector | undefined {
  return /^[0-9a-f]{6}$/i.test(hex)
    ? ([0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255) as Vector)
    : undefined;
}

/**
 * The fragment without its #. What is as at the beginning is left out; positions are rounded to 1e-5 of about `size`.
 */
export function formatAddress({ settings, camera, compared }: Address, size: number): string {
  const decimals = Math.min(20, Math.max(0, 5 - Math.floor(Math.log10(size || 1))));
  const point = (p: Vector) => p.map((x) => String(Number(x.toFixed(decimals)) + 0)).join(); // + 0 turns -0 into 0
  const pairs: [string, string][] = [];
  if (camera && 'view' in camera) pairs.push(['view', String(camera.view + 1)]);
  else if (camera) {
    pairs.push(['from', point(camera.from)], ['to', point(camera.to)]);
    if (camera.fov) pairs.push(['fov', short(camera.fov)]);
  }
  if (settings.mode !== DEFAULTS.mode) pairs.push(['mode', settings.mode]);
  if (!settings.photometric) pairs.push(['exposure', 'off']);
  if (settings.movement !== DEFAULTS.movement) pairs.push(['move', settings.movement]);
  if (settings.up) pairs.push(['up', settings.up]);
  if (settings.background) pairs.push(['background', hexColor(settings.background)]);
  if (settings.splatSize !== DEFAULTS.splatSize) pairs.push(['size', short(settings.splatSize)]);
  if (settings.points) pairs.push(['points', 'on']);
  if (settings.near > 0) pairs.push(['near', short(settings.near)]);
  if (settings.detail !== undefined) pairs.push(['detail', String(settings.detail)]);
  if (settings.panel !== undefined) pairs.push(['panel', settings.panel ? 'open' : 'closed']);
  if (compared) pairs.push(['compare', `${compared.left},${compared.right}`]);
  if (compared && percent(compared.split) !== percent(MIDDLE)) pairs.push(['split', percent(compared.split)]);
  return pairs.map((pair) => pair.join('=')).join('&');
}

/** So many numbers with commas between them, each within the bounds; undefined for anything else. */
function numbers(
  text: string | null,
  count: number,
  least = -LARGEST_NUMBER,
  most = LARGEST_NUMBER,
): number[] | undefined {
  const parts = text?.split(',') ?? [];
  const values = parts.map(Number);
  return parts.length === count &&
    parts.every((part) => part.trim() !== '') &&
    values.every((x) => x >= least && x <= most)
    ? values
    : undefined;
}

function parseCamera(given: URLSearchParams): AddressCamera | undefined {
  const view = numbers(given.get('view'), 1, 1)?.[0];
  if (view !== undefined && Number.isInteger(view)) return { view: view - 1 };
  const from = numbers(given.get('from'), 3) as Vector | undefined;
  const to = numbers(given.get('to'), 3) as Vector | undefined;
  if (!from || !to || Math.hypot(...from.map((x, i) => x - to[i])) === 0) return undefined;
  return { from, to, fov: numbers(given.get('fov'), 1, 1, LARGEST_FOV)?.[0] };
}

function parseCompared(given: URLSearchParams): Compared | undefined {
  const sides =
    given
      .get('compare')
      ?.split(',')
      .map((side) => SHOWN.find((name) => name === side)) ?? [];
  const [left, right] = sides;
  const split = numbers(given.get('split'), 1, 0, 100)?.[0];
  return sides.length === 2 && left && right
    ? { left, right, split: split === undefined ? MIDDLE : split / 100 }
    : undefined;
}

/** Takes what it understands of a fragment; the rest is as at the beginning. */
export function parseAddress(text: string): Address {
  const given = new URLSearchParams(text.replace(/^#/, ''));
  const detail = numbers(given.get('detail'), 1, 0, MOST_DETAIL)?.[0];
  const choice = <T extends string>(key: string, known: readonly T[]): T | undefined =>
    known.find((name) => name === given.get(key));
  const panel = choice('panel', PANEL);
  return {
    camera: parseCamera(given),
    compared: parseCompared(given),
    settings: {
      mode: choice<Mode>('mode', MODES) ?? DEFAULTS.mode,
      photometric: given.get('exposure') !== 'off',
      movement: choice<MovementName>('move', ['orbit', 'fly']) ?? DEFAULTS.movement,
      up: choice<AxisName>('up', AXES),
      background: colorOf(given.get('background') ?? ''),
      splatSize: numbers(given.get('size'), 1, SPLAT_SIZES.least, SPLAT_SIZES.most)?.[0] ?? DEFAULTS.splatSize,
      points: given.get('points') === 'on',
      near: numbers(given.get('near'), 1, 0)?.[0] ?? DEFAULTS.near,
      detail: Number.isInteger(detail) ? detail : DEFAULTS.detail,
      panel: panel === undefined ? DEFAULTS.panel : panel === 'open',
    },
  };
}

/** Browsers take about a hundred changes of the address in 30 seconds. */
const INTERVAL = 400;

/** Keeps the page's address up to date with what `text` says. */
export class AddressBar {
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly text: () => string) {}

  /** Something may have changed. */
  touch(): void {
    this.timer ??= setTimeout(() => this.write(), INTERVAL);
  }

  /** Writes at once. */
  write(): void {
    clearTimeout(this.timer);
    this.timer = undefined;
    const text = this.text();
    if (text !== location.hash.slice(1))
      history.replaceState(null, '', text ? `#${text}` : location.pathname + location.search);
  }
}
