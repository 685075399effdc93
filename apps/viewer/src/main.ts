// SPDX-License-Identifier: Apache-2.0
import { App } from './app';
import { fetchSource } from './format/load';
import { onFile } from './ui/drop';
import { showError, showWelcome } from './ui/notice';

/** What tests of the page use, as `window.gsapp`; it is there once the first model is shown or could not be. */
declare global {
  interface Window {
    gsapp?: Pick<App, 'testViewPixels' | 'benchmark'>;
  }
}

/** `?model=URL`, or the file that gsapp export puts beside this page. */
async function openFirst(app: App): Promise<void> {
  const wanted = new URLSearchParams(location.search).get('model');
  if (wanted !== null) return app.open((signal) => fetchSource(wanted, signal));
  const beside = await fetchSource('scene.ngsplat', new AbortController().signal).catch(() => undefined);
  return beside ? app.open(beside).then(() => app.readSite()) : showWelcome();
}

try {
  const app = new App();
  onFile((source) => void app.open(source));
  await openFirst(app);
  window.gsapp = app;
} catch (error) {
  showError('The viewer cannot start', (error as Error).message, false);
}
