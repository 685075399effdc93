// SPDX-License-Identifier: Apache-2.0
import { App } from './app';
import { fetchSource } from './format/load';
import { Live } from './live/live';
import type { Pictures } from './pictures';
import { onFile } from './ui/drop';
import { showError, showWelcome } from './ui/notice';
import { findDevice } from './webgpu/device';

/** What tests of the page use, as `window.gsapp`; it is there once the first model is shown or could not be. */
declare global {
  interface Window {
    gsapp?: Pick<Pictures, 'testViewPixels' | 'viewPixels' | 'testViewOrder' | 'way' | 'benchmark'>;
    /** The same from the beginning, while the first model is on its way. */
    gsappLoading?: Window['gsapp'];
  }
}

const given = new URLSearchParams(location.search);

/** `?live`, `?model=URL`, or the file that gsapp export puts beside this page. */
async function openFirst(app: App): Promise<void> {
  const wanted = given.get('model');
  if (given.has('live')) return void new Live(app);
  if (wanted !== null) return app.loader.open((signal) => fetchSource(wanted, signal));
  let beside = await fetchSource('scene.ngsplat', new AbortController().signal).catch(() => undefined);
  if (!beside) return showWelcome();
  return app.loader.open(async (signal) => {
    const first = beside ?? (await fetchSource('scene.ngsplat', signal));
    beside = undefined; // a stream is read once
    return first;
  }, 'beside');
}

/** `?embed`: the picture alone, for a frame in another page. */
document.body.classList.toggle('embedded', given.has('embed'));
let app: App | undefined;
try {
  app = new App(await findDevice(given.get('gpu')));
  window.gsappLoading = app.pictures;
} catch (error) {
  showError('The viewer cannot start', (error as Error).message, false);
  // Nothing can be shown; the message says why.
  for (const control of document.querySelectorAll<HTMLInputElement>(
    '#controls :is(button, input, select), #notice-actions button, #toggle',
  ))
    control.disabled = true;
}
onFile(app && ((source) => void app.loader.open(source, 'elsewhere')));
if (app) {
  await openFirst(app);
  window.gsapp = app.pictures;
}
