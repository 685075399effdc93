// SPDX-License-Identifier: Apache-2.0
// Films of the model: what plays on the page, and its recording.

import type { Navigator } from './camera/navigator';
import { turntable, type CameraPath } from './camera/path';
import type { View } from './camera/view';
import type { Scene } from './format/ngsplat';
import { FilmPanel } from './ui/film_panel';
import { record } from './ui/recorder';

/** What films need of the page. */
export interface FilmedPage {
  /** What is shown. Throws where there is no model. */
  model(): { navigator: Navigator; scene: Scene };
  canvas(): HTMLCanvasElement;
  show(view: View): void;
  /** Draws at once. */
  draw(): void;
}

export class Films {
  private readonly panel: FilmPanel;
  private playing = new AbortController();

  constructor(private readonly page: FilmedPage) {
    this.panel = new FilmPanel({
      view: () => page.model().navigator.current(),
      show: (view) => page.show(view),
      turntable: () => {
        const { navigator, scene } = page.model();
        return turntable(navigator.current(), navigator.target, scene.up);
      },
      frame: () => page.model().scene.frame,
      play: (path, seconds) => this.play(path, seconds),
      record: (path, seconds) => record(page.canvas(), () => this.play(path, seconds)),
      stop: () => this.stop(),
    });
  }

  addKeyframe(): void {
    this.panel.add();
  }

  /** Ends what plays: the user moves, or the model goes. */
  stop(): void {
    this.playing.abort();
  }

  /** Shows a path in its time, until it is stopped. */
  private async play(path: CameraPath, seconds: number): Promise<void> {
    this.stop();
    const { signal } = (this.playing = new AbortController());
    const { navigator } = this.page.model();
    const begin = performance.now();
    for (let time = 0; !signal.aborted;) {
      navigator.showExactly(path(time));
      this.page.draw();
      if (time === 1) return;
      await new Promise(requestAnimationFrame);
      time = Math.min(1, (performance.now() - begin) / 1000 / seconds);
    }
  }
}
