// SPDX-License-Identifier: Apache-2.0
// Which level of a model is shown: what the user chose, else the finest that fits into the device's memory and is drawn
// fast enough.

import { DetailPanel } from '../ui/detail_panel';
import { memoryHere, memoryOf } from './memory';
import { Pace } from './pace';

/** A file with all or some of a model's Gaussians. */
export interface Level {
  file: string;
  count: number;
  bytes: number;
  /** The mean of the test views, in decibels. */
  psnr?: number;
}

/** The finest level of all, the finest first, that a device with so much memory can show: at worst the last. */
export function finestThatFits(levels: Level[], memory: number): number {
  const index = levels.findIndex(({ bytes, count }) => memoryOf(bytes, count) <= memory);
  return index < 0 ? levels.length - 1 : index;
}

export class Levels {
  private all: Level[] = [];
  private shown = 0;
  private chosen: number | undefined;
  /** The finest that is shown unasked, for memory and for speed. */
  private fits = 0;
  private fast = 0;
  /**
   * The bytes of the smallest level that the device could not hold. It is not shown again unasked while the page lives.
   */
  private tooLarge = Infinity;
  private isBusy = false;
  private pace = new Pace();
  private readonly panel: DetailPanel;

  /**
   * `show` shows another file of the model; it returns false where that cannot be now. `choose` is called with what the
   * user chose.
   */
  constructor(
    private readonly show: (file: string) => Promise<boolean>,
    choose: (level: number | undefined) => void,
  ) {
    this.panel = new DetailPanel(choose);
  }

  /** There is no model, or another one. */
  clear(): void {
    this.all = [];
    this.panel.clear();
  }

  /** The file to begin with. */
  begin(levels: Level[], chosen: number | undefined): string {
    return levels[this.known(levels, chosen) ?? this.finestHere(levels)].file;
  }

  /** The device could not hold so many bytes of a model. */
  refuse(bytes: number): void {
    this.tooLarge = Math.min(this.tooLarge, bytes);
  }

  private finestHere(levels: Level[]): number {
    const smaller = levels.findIndex(({ bytes }) => bytes < this.tooLarge);
    return Math.max(finestThatFits(levels, memoryHere()), smaller < 0 ? levels.length - 1 : smaller);
  }

  /** What there is of the model, of which `file` is shown. */
  set(levels: Level[], file: string, chosen: number | undefined): void {
    if (levels.length < 2) return;
    this.all = levels;
    this.pace = new Pace();
    this.shown = Math.max(
      0,
      levels.findIndex((level) => level.file === file),
    );
    this.fits = this.finestHere(levels);
    this.chosen = this.known(levels, chosen);
    this.fast = this.chosen === undefined ? this.shown : this.fits; // if this is coarser, there was a reason
    this.panel.setLevels(levels, this.chosen);
    void this.update();
  }

  private known(levels: Level[], level: number | undefined): number | undefined {
    return level !== undefined && level < levels.length ? level : undefined;
  }

  /** What the user wants; undefined leaves it to the page. */
  choose(level: number | undefined): void {
    if (this.all.length === 0 || this.known(this.all, level) === this.chosen) return;
    this.chosen = this.known(this.all, level);
    if (this.chosen === undefined) this.fast = this.fits;
    this.panel.setLevels(this.all, this.chosen);
    void this.update();
  }

  /** A frame was drawn so many milliseconds after it was asked for. */
  frame(milliseconds: number): void {
    if (this.all.length === 0 || this.isBusy || this.chosen !== undefined) return;
    const next = this.pace.frame(milliseconds);
    if (next === undefined) return;
    this.fast = Math.min(this.all.length - 1, Math.max(this.fits, this.shown + (next === 'coarser' ? 1 : -1)));
    void this.update();
  }

  /**
   * The file of the next coarser level, for a device that lost its memory; undefined where there is none, or the user
   * chose.
   */
  smallerAfterLoss(): string | undefined {
    if (this.chosen !== undefined || this.all.length <= this.shown + 1) return undefined;
    this.refuse(this.all[this.shown].bytes);
    return this.all[this.shown + 1].file;
  }

  /** Brings what is shown to what is wanted. */
  private async update(): Promise<void> {
    const { all } = this;
    if (this.isBusy) return; // it looks again at its end
    for (this.isBusy = true; all === this.all;) {
      const wanted = this.chosen ?? Math.max(this.fits, this.fast);
      if (wanted === this.shown) {
        this.panel.say(this.reason(wanted));
        break;
      }
      this.panel.say(`Loading ${all[wanted].file}…`);
      try {
        if (await this.show(all[wanted].file)) this.shown = wanted;
        else await new Promise((resolve) => setTimeout(resolve, 200)); // something else needs the model
      } catch (error) {
        if (all === this.all) this.panel.say(`${all[wanted].file} cannot be shown: ${(error as Error).message}`);
        this.chosen = this.shown;
        break;
      }
      this.pace.begin();
    }
    this.isBusy = false;
    if (all !== this.all && this.all.length > 0) await this.update();
  }

  private reason(level: number): string {
    const why =
      this.chosen !== undefined
        ? 'as you chose'
        : level === 0
          ? 'all of them'
          : level > this.fits
            ? 'since finer ones were too slow or too large'
            : 'since this device has little memory';
    const { count, psnr } = this.all[level];
    return `${count.toLocaleString('en')} Gaussians, ${why}${psnr === undefined ? '' : `: ${psnr.toFixed(2)} dB on the test views`}.`;
  }
}
