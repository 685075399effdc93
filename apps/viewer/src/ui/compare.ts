// SPDX-License-Identifier: Apache-2.0
// The settings of a comparison, and the divider between its two pictures.

import { MODES, type Mode } from '../render/prepass';
import { element } from './elements';

/** What a side of the divider can show. */
export type Shown = Mode | 'photograph' | 'other';
export const SHOWN: readonly Shown[] = [...MODES, 'photograph', 'other'];
export interface Sides {
  left: Shown;
  right: Shown;
}
/** Where the divider is at the beginning. */
export const MIDDLE = 0.5;
/** A comparison: its sides, and where the divider is, from 0 at the left to 1. */
export interface Compared extends Sides {
  split: number;
}

export const MODE_NAMES: Record<Mode, string> = {
  full: 'Full',
  base: 'Base',
  residual: 'Residual',
  depth: 'Depth',
  appearance: 'View-dependence',
};
const OTHER = 'Other model';

/** The parts of the width that an arrow key and page keys move. */
const STEP = 0.01;
const PAGE = 0.1;
const KEYS: Record<string, (split: number) => number> = {
  ArrowLeft: (split) => split - STEP,
  ArrowDown: (split) => split - STEP,
  ArrowRight: (split) => split + STEP,
  ArrowUp: (split) => split + STEP,
  PageDown: (split) => split - PAGE,
  PageUp: (split) => split + PAGE,
  Home: () => 0,
  End: () => 1,
};

export class ComparePanel {
  private readonly on = element<HTMLInputElement>('compare-on');
  private readonly left = element<HTMLSelectElement>('compare-left');
  private readonly right = element<HTMLSelectElement>('compare-right');
  private readonly divider = element('divider');
  private readonly labels = [element('label-left'), element('label-right')];
  /** Where the divider is, from 0 at the left to 1. */
  split = MIDDLE;
  /** The sides are somebody's choice, and stay when another model comes. */
  private isChosen = false;

  /** `changed` is called when another picture is wanted. */
  constructor(private readonly changed: () => void) {
    const choices: [Shown, string][] = [
      ...(Object.entries(MODE_NAMES) as [Mode, string][]),
      ['photograph', 'Photograph'],
      ['other', OTHER],
    ];
    for (const select of [this.left, this.right]) {
      select.replaceChildren(...choices.map(([value, name]) => new Option(name, value)));
      select.addEventListener('change', () => {
        this.isChosen = true;
        changed();
      });
    }
    this.right.value = 'base';
    this.on.addEventListener('change', () => this.showParts());
    this.addDivider();
  }

  /** Shows what belongs to a comparison while it is on. */
  private showParts(): void {
    const { isOn } = this;
    for (const part of [element('compare-sides'), this.divider, ...this.labels]) part.hidden = !isOn;
    element('modes').closest('fieldset')!.disabled = isOn; // the sides say what is shown
    this.changed();
  }

  /** Undefined while one picture is shown. */
  get compared(): Compared | undefined {
    return this.isOn ? { ...this.sides, split: this.split } : undefined;
  }

  set compared(compared: Compared | undefined) {
    this.on.checked = compared !== undefined;
    if (compared) {
      [this.left.value, this.right.value, this.isChosen] = [compared.left, compared.right, true];
      this.move(compared.split);
    }
    this.showParts();
  }

  get isOn(): boolean {
    return this.on.checked;
  }

  get sides(): Sides {
    return { left: this.left.value as Shown, right: this.right.value as Shown };
  }

  /**
   * Names the other model, if there is one, and sets the picture on the right of the divider unless somebody has
   * chosen one.
   */
  setOther(name: string | undefined, right?: Shown): void {
    for (const select of [this.left, this.right]) {
      for (const option of select.options)
        if (option.value === 'other') option.textContent = name === undefined ? OTHER : `${OTHER}: ${name}`;
    }
    if (right && !this.isChosen) this.right.value = right;
  }

  setLabels(left: string, right: string): void {
    for (const [i, text] of [left, right].entries())
      if (this.labels[i].textContent !== text) this.labels[i].textContent = text; // read aloud once
  }

  setHelp(text: string): void {
    element('compare-help').textContent = text;
  }

  private move(split: number): void {
    this.split = Math.min(1, Math.max(0, split));
    this.divider.style.left = `${100 * this.split}%`;
    this.divider.ariaValueNow = String(Math.round(100 * this.split));
    this.divider.ariaValueText = `${Math.round(100 * this.split)} % of the width`;
    this.changed();
  }

  private addDivider(): void {
    const { divider } = this;
    const follow = (event: PointerEvent) => {
      const { left, width } = divider.parentElement!.getBoundingClientRect();
      this.move((event.clientX - left) / width);
    };
    divider.addEventListener('pointerdown', (event) => {
      divider.setPointerCapture(event.pointerId);
      event.preventDefault(); // no text is selected
      divider.focus();
    });
    divider.addEventListener('pointermove', (event) => {
      if (divider.hasPointerCapture(event.pointerId)) follow(event);
    });
    divider.addEventListener('keydown', (event) => {
      const next = KEYS[event.key];
      if (!next || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      event.stopPropagation(); // the camera has the same keys
      this.move(next(this.split));
    });
  }
}
