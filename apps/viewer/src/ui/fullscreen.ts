// SPDX-License-Identifier: Apache-2.0
// The picture on the whole screen.

import { element } from './elements';

/** Browsers leave by Escape. */
export function toggleFullscreen(): void {
  if (document.fullscreenElement) void document.exitFullscreen();
  else
    void element('stage')
      .requestFullscreen?.()
      .catch(() => undefined); // a page around this one may not allow it
}

const button = element('fullscreen');
button.hidden = !document.fullscreenEnabled;
button.addEventListener('click', toggleFullscreen);
