// SPDX-License-Identifier: Apache-2.0
// From how long frames take: whether a coarser level is needed, or there is room for a finer one.

/** Milliseconds of a frame: longer is slow, shorter is fast. In between everything stays as it is. */
const SLOW = 50;
const FAST = 25;
/**
 * Milliseconds of slow frames, each of which counts as so many at most: a tab in the background draws none for hours.
 */
const PATIENCE = 2000;
const MOST = 500;
/** Fast frames in a row. Each coarser level doubles them, so that the page does not go back and forth. */
const FAST_FRAMES = 300;

export class Pace {
  private slow = 0;
  private fast = 0;
  private needed = FAST_FRAMES;

  /**
   * A frame that was asked for has been drawn, so many milliseconds later. Returns what to show from now on, where that
   * is something else.
   */
  frame(milliseconds: number): 'coarser' | 'finer' | undefined {
    const isSlow = milliseconds > SLOW;
    this.slow = Math.max(0, this.slow + (isSlow ? Math.min(milliseconds, MOST) : -milliseconds));
    this.fast = milliseconds < FAST ? this.fast + 1 : isSlow ? 0 : this.fast;
    if (this.slow >= PATIENCE) {
      this.begin();
      this.needed *= 2;
      return 'coarser';
    }
    if (this.fast < this.needed) return undefined;
    this.begin();
    return 'finer';
  }

  /** Another level is shown. */
  begin(): void {
    this.slow = this.fast = 0;
  }
}
