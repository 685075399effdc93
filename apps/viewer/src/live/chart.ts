// SPDX-License-Identifier: Apache-2.0
// A curve as a small picture: it shows the course, the numbers stand beside it.

import type { Curve } from './status';

const WIDTH = 100;
const HEIGHT = 30;

/**
 * Points of a polyline in WIDTH x HEIGHT, from the first iteration to the last and from the least value to the largest.
 */
export function polyline(curve: Curve): string {
  const known = curve.values.flatMap((value, i) => (value === null ? [] : [[curve.iterations[i], value] as const]));
  if (known.length < 2) return '';
  const values = known.map(([, value]) => value);
  const low = Math.min(...values);
  const high = Math.max(...values);
  const [first] = known[0];
  const [last] = known[known.length - 1];
  const x = (iteration: number) => (WIDTH * (iteration - first)) / Math.max(last - first, 1);
  const y = (value: number) => (high > low ? HEIGHT - (HEIGHT * (value - low)) / (high - low) : HEIGHT / 2);
  return known.map(([iteration, value]) => `${x(iteration).toFixed(2)},${y(value).toFixed(2)}`).join(' ');
}

/** Draws the curve into an <svg>, and says in words what it shows. */
export function drawCurve(svg: SVGSVGElement, curve: Curve, label: string): void {
  svg.setAttribute('viewBox', `0 -1 ${WIDTH} ${HEIGHT + 2}`);
  svg.setAttribute('preserveAspectRatio', 'none');
  svg.setAttribute('role', 'img');
  svg.setAttribute('aria-label', label);
  let line = svg.querySelector('polyline');
  if (!line) {
    line = document.createElementNS('http://www.w3.org/2000/svg', 'polyline');
    line.setAttribute('vector-effect', 'non-scaling-stroke');
    svg.append(line);
  }
  line.setAttribute('points', polyline(curve));
}
