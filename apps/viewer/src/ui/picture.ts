// SPDX-License-Identifier: Apache-2.0
// The picture's own messages, which pass, and its keys.

import { element } from './elements';

const SHOWN_MILLISECONDS = 1500;
const said = element('said');
let hiding: ReturnType<typeof setTimeout> | undefined;

/** Says at which factor of the usual speed flying goes, for a moment. */
export function showSpeed(factor: number): void {
  said.textContent = `Speed × ${Number(factor.toPrecision(2))}`;
  said.hidden = false;
  clearTimeout(hiding);
  hiding = setTimeout(() => (said.hidden = true), SHOWN_MILLISECONDS);
}

/** Keys act on the picture at once, unless the user is at something else, or the page is a frame of another one. */
export function focusPicture(canvas: HTMLCanvasElement): void {
  const { activeElement } = document;
  const isFree = !activeElement || activeElement === document.body || element('notice').contains(activeElement);
  if (isFree && window.top === window) canvas.focus({ preventScroll: true, focusVisible: false } as FocusOptions);
}
