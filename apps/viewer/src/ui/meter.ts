// SPDX-License-Identifier: Apache-2.0
// Frames per second while the picture moves, and how long the last sort took.

import { element } from './elements';

/** Pauses longer than this are not a slow frame: nothing moved. */
const PAUSE = 500;
/** Fewer frames in a row say nothing about a rate. */
const FEWEST_FRAMES = 5;

export class Meter {
  private last = -Infinity;
  private interval = 0;
  private frames = 0;
  private rate = '';
  private sorted: number | 'on the GPU' | undefined;

  constructor(private readonly output = element('meter')) {}

  /**
   * A frame was drawn. `sorted`: the milliseconds that its order took, or where that is part of drawing; undefined
   * while there is none.
   */
  frame(now: number, sorted: number | 'on the GPU' | undefined, drawn: number): void {
    const dt = now - this.last;
    this.last = now;
    this.frames = dt > PAUSE ? 0 : this.frames + 1;
    this.interval = this.frames > 1 ? 0.9 * this.interval + 0.1 * dt : dt;
    this.rate = this.frames >= FEWEST_FRAMES ? `${(1000 / this.interval).toFixed(0)} frames/s · ` : '';
    this.sorted = sorted;
    this.show(drawn);
  }

  /** The number of Gaussians in the last frame has become known. */
  show(drawn: number): void {
    const { rate, sorted } = this;
    const order =
      sorted === undefined
        ? 'sorting…'
        : `${drawn.toLocaleString('en')} drawn · sorted ${typeof sorted === 'number' ? `in ${sorted.toFixed(0)} ms` : sorted}`;
    this.output.textContent = `${rate}${order}`;
  }
}
