// SPDX-License-Identifier: Apache-2.0
// The box in front of the picture: what is loading, what went wrong, where to begin.

import { element } from './elements';

const box = element('notice');
const title = element('notice-title');
const text = element('notice-text');
const progress = element<HTMLProgressElement>('progress');
const actions = element('notice-actions');
const dismiss = element('dismiss');

function show(
  heading: string,
  body: string,
  parts: { progress?: boolean; actions?: boolean; dismiss?: boolean; aside?: boolean },
): void {
  title.textContent = heading;
  text.textContent = body;
  progress.hidden = !parts.progress;
  actions.hidden = !parts.actions;
  dismiss.hidden = !parts.dismiss;
  box.ariaBusy = String(parts.progress ?? false); // not every part of a file is read aloud
  box.classList.toggle('aside', parts.aside ?? false);
  box.hidden = false;
}

export const megabytes = (bytes: number): string => `${(bytes / 1e6).toFixed(bytes < 1e8 ? 1 : 0)} MB`;

/** With `aside`, there is a picture to see meanwhile. */
export function showLoading(name: string, bytes: number, size?: number, aside = false): void {
  show(`Loading ${name}`, size ? `${megabytes(bytes)} of ${megabytes(size)}` : megabytes(bytes), {
    progress: true,
    aside,
  });
  if (size) progress.value = Math.min(bytes / size, 1);
  else progress.removeAttribute('value');
}

/** With `dismissable`, what was shown before is still there. */
export function showError(heading: string, message: string, dismissable: boolean): void {
  show(heading, message, { actions: true, dismiss: dismissable });
}

/** Something that the user should know of what is shown, below the picture's middle. */
export function showRemark(heading: string, message: string): void {
  show(heading, message, { actions: true, dismiss: true, aside: true });
}

export function showWelcome(): void {
  show(
    'No model yet',
    'Drop an .ngsplat, .ply, .splat or .spz file here, or open one. gsapp export --format web writes the first.',
    { actions: true },
  );
}

export function hideNotice(): void {
  box.hidden = true;
}

dismiss.addEventListener('click', hideNotice);

/** Does what the button Close does; nothing where there is none. */
export function dismissNotice(): void {
  if (!box.hidden && !actions.hidden && !dismiss.hidden) hideNotice();
}
