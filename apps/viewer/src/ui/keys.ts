// SPDX-License-Identifier: Apache-2.0
// Keys beside those that move the camera. Letters act on the picture alone, so that they never meet what someone
// dictates or types elsewhere.

import { element } from './elements';
import { dismissNotice } from './notice';

/** What the letters do, each by its lower case. */
export type Actions = Record<string, () => void>;

const isTyping = (target: EventTarget | null): boolean =>
  target instanceof HTMLElement && target.matches('input:not([type=radio], [type=checkbox], [type=range]), select');

export function onKeys(canvas: HTMLCanvasElement, actions: Actions, escape: () => void): void {
  const help = element<HTMLDialogElement>('help');
  const open = () => {
    if (!help.open) help.showModal();
  };
  element('open-help').addEventListener('click', open);
  addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
    if (event.key === '?') open();
    else if (event.key === 'Escape' && !help.open) {
      dismissNotice();
      escape();
    }
  });
  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
    actions[event.key.toLowerCase()]?.();
  });
}
