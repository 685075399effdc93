// SPDX-License-Identifier: Apache-2.0
import { App } from './app';
import { fetchSource } from './format/load';
import { Live } from './live/live';
import { onFile } from './ui/drop';
import { showError, showWelcome } from './ui/notice';

/** What tests of the page use, as `window.gsapp`; it is there once the first model is shown or could not be. */
declare global {
  interface Window {
    gsapp?: Pick<App, 'testViewPixels' | 'viewPixels' | 'benchmark'>;
    /** The same from the beginning, while the first model is on its way. */
    gsappLoading?: Window['gsapp'];
  }
}

/** `?live`, `?model=URL`, or the file that gsapp export puts beside this page. */
async function openFirst(app: App): Promise<void> {
  const query = new URLSearchParams(location.search), wanted = query.get('model');
  if (query.has('live')) return void new Live(app);
  if (wanted !== null) return app.open((signal) => fetchSource(wanted, signal));
  const beside = await fetchSource('scene.ngsplat', new AbortController().signal).catch(() => undefined);
  return beside ? app.open(beside).then(() => app.readSite()) : showWelcome();
}

try {
  const app = (window.gsappLoading = new App());
  onFile((source) => void app.open(source));
  await openFirst(app);
  window.gsapp = app;
} catch (error) {
  showError('The viewer cannot start', (error as Error).message, false);
}
