// SPDX-License-Identifier: Apache-2.0
// The choice among the levels of a model, and what is said of the one that is shown.

import type { Level } from '../levels/levels';
import { element } from './elements';

export class DetailPanel {
  private readonly box = element('detail-box');
  private readonly list = element<HTMLSelectElement>('detail');

  /** `choose` gets a level, or undefined where the page is to decide. */
  constructor(choose: (level: number | undefined) => void) {
    this.list.addEventListener('change', () => choose(this.list.value === '' ? undefined : Number(this.list.value)));
  }

  clear(): void {
    this.box.hidden = true;
  }

  setLevels(levels: Level[], chosen: number | undefined): void {
    const name = ({ count, psnr }: Level, k: number) =>
      `${k === 0 ? 'All' : `1/${Math.round(levels[0].count / count)}`}: ${count.toLocaleString('en')}${psnr === undefined ? '' : `, ${psnr.toFixed(2)} dB`}`;
    this.list.replaceChildren(
      new Option('Automatic', ''),
      ...levels.map((level, k) => new Option(name(level, k), String(k))),
    );
    this.list.value = chosen === undefined ? '' : String(chosen);
    this.box.hidden = false;
  }

  say(text: string): void {
    const state = element('detail-state');
    if (state.textContent !== text) state.textContent = text; // read aloud once
  }
}
