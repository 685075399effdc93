// SPDX-License-Identifier: Apache-2.0
// The page of a model that is training or was just opened: asks gsapp every second while somebody looks, and shows each
// new snapshot.

import type { App } from '../app';
import { fetchSource } from '../format/load';
import { LivePanel } from './live_panel';
import { fetchStatus, sendControl, type Control, type Status } from './status';

const INTERVAL = 1000;
const TOKEN_KEY = 'gsapp-token';

/** The token of the printed address moves to where copies of the address do not carry it. */
function takeToken(): string {
  const query = new URLSearchParams(location.search);
  const token = query.get('token');
  if (token !== null) {
    query.delete('token');
    history.replaceState(history.state, '', `?${query.toString().replace(/=(?=&|$)/g, '')}${location.hash}`);
  }
  try {
    if (token !== null) sessionStorage.setItem(TOKEN_KEY, token);
    return sessionStorage.getItem(TOKEN_KEY) ?? '';
  } catch {
    return token ?? ''; // this browser keeps nothing: the buttons work until the page is loaded anew
  }
}

export class Live {
  private token = takeToken();
  private readonly panel = new LivePanel((control) => this.control(control));
  /** What is shown: program and version of the snapshot. */
  private id = '';
  private version = 0;
  private photographs = 0;
  private loading = false;
  private readonly again = () => {
    this.version = 0;
    this.photographs = -1; // what lies beside the model was forgotten with it
    return this.look();
  };

  constructor(private readonly app: App) {
    app.loader.setAgain(this.again, true);
    document.addEventListener('visibilitychange', () => void this.look());
    setInterval(() => void this.look(), INTERVAL);
    void this.look();
  }

  private async control(control: Control): Promise<void> {
    try {
      const taken = await sendControl(control, this.token);
      if (!taken) this.token = ''; // of a program that has ended
      this.panel.say(
        taken
          ? ''
          : 'Only the page whose address gsapp printed may do this; a program that was started anew prints another.',
      );
    } catch {
      this.panel.say('gsapp did not answer.');
    }
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
    const isSame = id === this.id;
    if (!model || (isSame && model.version === this.version) || this.loading) return;
    if (!this.app.loader.isFrom(this.again)) return; // the user has opened another file
    this.loading = true;
    try {
      const source = await fetchSource(model.url, new AbortController().signal);
      if (!(await this.app.loader.refresh({ ...source, name: scene }, isSame))) return;
      if (!isSame || photographs !== this.photographs)
        this.app.setSite({
          name: scene,
          photographs:
            photographs > 0 ? Array.from({ length: photographs }, (_, k) => `live/photograph/${k}.jpg`) : undefined,
        });
      [this.id, this.version, this.photographs] = [id, model.version, photographs];
      this.panel.showPicture(id, model.iteration);
    } catch {
      // replaced by a newer one meanwhile, which the next look finds
    } finally {
      this.loading = false;
    }
  }
}
