// SPDX-License-Identifier: Apache-2.0
// Frames per second while the picture moves, and how long the last sort took.

import { element } from './elements';

/** Pauses longer than this are not a slow frame: nothing moved. */
const PAUSE = 500;

export class Meter {
  private last = -Infinity;
  private interval = 0;

  constructor(private readonly output = element('meter')) {}

  /** A frame was drawn. */
  frame(now: number, sortMilliseconds: number, drawn: number): void {
    const dt = now - this.last;
    this.last = now;
    if (dt > PAUSE) this.interval = 0;
    else this.interval = this.interval ? 0.9 * this.interval + 0.1 * dt : dt;
    const rate = this.interval ? `${(1000 / this.interval).toFixed(0)} frames/s · ` : '';
    this.output.textContent = `${rate}${drawn.toLocaleString('en')} drawn · sorted in ${sortMilliseconds.toFixed(0)} ms`;
  }
}
