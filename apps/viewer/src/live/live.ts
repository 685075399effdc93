// SPDX-License-Identifier: Apache-2.0
// The page of a model that is training or was just opened: asks gsapp every second while somebody looks, and shows each new snapshot.

import type { App } from '../app';
import { fetchSource } from '../format/load';
import { LivePanel } from './live_panel';
import { fetchStatus, sendControl, type Control, type Status } from './status';

const INTERVAL = 1000;
const TOKEN_KEY = 'gsapp-token';

/** The token of the printed address moves to where copies of the address do not carry it. */
function takeToken(): string {
  const query = new URLSearchParams(location.search), token = query.get('token');
  if (token !== null) {
    sessionStorage.setItem(TOKEN_KEY, token);
    query.delete('token');
    history.replaceState(history.state, '', `?${query.toString().replace(/=(?=&|$)/g, '')}${location.hash}`);
  }
  return sessionStorage.getItem(TOKEN_KEY) ?? '';
}

export class Live {
  private readonly token = takeToken();
  private readonly panel = new LivePanel((control) => this.control(control));
  private shown = '';
  private loading = false;

  constructor(private readonly app: App) {
    app.setAgain(() => {
      this.shown = '';
      return this.look();
    }, true);
    document.addEventListener('visibilitychange', () => void this.look());
    setInterval(() => void this.look(), INTERVAL);
    void this.look();
  }

  private async control(control: Control): Promise<void> {
    const taken = await sendControl(control, this.token).catch(() => false);
    if (!taken) this.panel.showRefused();
    await this.look();
  }

  private async look(): Promise<void> {
    if (document.hidden) return; // a training pays for being looked at
    try {
      const status = await fetchStatus();
      this.panel.show(status, this.token !== '');
      await this.load(status);
    } catch {
      this.panel.showLost();
    }
  }

  private async load({ id, scene, model, photographs }: Status): Promise<void> {
    const wanted = model ? `${id} ${model.version}` : '';
    if (!model || wanted === this.shown || this.loading) return;
    this.loading = true;
    try {
      const source = await fetchSource(model.url, new AbortController().signal);
      if (!(await this.app.refresh({ ...source, name: scene }))) return;
      if (!this.shown && photographs > 0) this.app.setSite({ name: scene, photographs: Array.from({ length: photographs }, (_, k) => `live/photograph/${k}.jpg`) });
      this.shown = wanted;
    } catch {
      // replaced by a newer one meanwhile, which the next look finds
    } finally {
      this.loading = false;
    }
  }
}
