// SPDX-License-Identifier: Apache-2.0
// Films: a turntable, and a path through keyframes, which can be saved and loaded.

import { keyframePath, pathFrames, type CameraPath } from '../camera/path';
import { formatCameras, formatNerfstudio, parsePath } from '../camera/path_files';
import type { View } from '../camera/view';
import type { Frame } from '../format/trailer';
import { element, save } from './elements';

/** What the panel asks of the page; all throw where there is no model. */
export interface FilmStage {
  view(): View;
  show(view: View): void;
  turntable(): CameraPath;
  /** The frame of the model's coordinates. */
  frame(): Frame | undefined;
  /** Until the end, or until `stop`. */
  play(path: CameraPath, seconds: number): Promise<void>;
  record(path: CameraPath, seconds: number): Promise<Blob>;
  stop(): void;
}

export class FilmPanel {
  private readonly list = element<HTMLOListElement>('keyframes');
  private readonly message = element('film-message');
  private readonly seconds = element<HTMLInputElement>('seconds');
  private readonly rate = element<HTMLInputElement>('frame-rate');
  private readonly stopButton = element<HTMLButtonElement>('stop-film');
  private keyframes: View[] = [];

  constructor(private readonly stage: FilmStage) {
    const film = (path: () => CameraPath) => ({
      play: () => this.run(() => stage.play(path(), this.duration())),
      record: () =>
        this.run(async () => {
          const blob = await stage.record(path(), this.duration());
          save(blob, 'video.webm');
          this.message.textContent = `Saved, ${(blob.size / 1e6).toFixed(1)} MB.`;
        }),
    });
    const around = film(() => stage.turntable());
    const along = film(() => keyframePath(this.keyframes));
    const buttons: Record<string, () => void> = {
      'play-turntable': around.play,
      'record-turntable': around.record,
      'play-path': along.play,
      'record-path': along.record,
      'stop-film': () => stage.stop(),
      'add-keyframe': this.add,
      'save-cameras': () => this.saveAs('cameras.json', (frames) => formatCameras(frames, stage.frame())),
      'save-nerfstudio': () =>
        this.saveAs('camera_path.json', (frames) => formatNerfstudio(frames, this.duration(), stage.frame())),
      'load-path': () => file.click(),
    };
    for (const [id, action] of Object.entries(buttons))
      element(id).addEventListener('click', () => this.attempt(action));
    const file = element<HTMLInputElement>('path-file');
    file.addEventListener('change', async () => {
      const [chosen] = file.files ?? [];
      const text = await chosen?.text();
      file.value = ''; // the same file may be loaded again
      if (text !== undefined) this.attempt(() => this.load(text));
    });
    this.update();
  }

  /** Does it, and says what is wrong where it cannot be done. */
  private attempt(action: () => void): void {
    this.message.textContent = '';
    try {
      action();
    } catch (error) {
      this.message.textContent = (error as Error).message;
    }
  }

  private duration(): number {
    if (!this.seconds.checkValidity()) throw new Error('Seconds are from 1 to 600.');
    return this.seconds.valueAsNumber;
  }

  /** Plays something; other films wait. */
  private async run(work: () => Promise<void>): Promise<void> {
    const before = document.activeElement as HTMLElement | null;
    this.update(true);
    this.stopButton.focus({ preventScroll: true });
    try {
      await work();
    } catch (error) {
      this.message.textContent = (error as Error).message;
    }
    const isWaiting = document.activeElement === this.stopButton || document.activeElement === document.body;
    this.update();
    if (isWaiting) before?.focus({ preventScroll: true });
  }

  readonly add = (): void => {
    const view = this.stage.view();
    this.keyframes.push({ ...view, cx: view.width / 2, cy: view.height / 2 }); // files have no other centre
    this.update();
  };

  private load(text: string): void {
    const { keyframes, seconds } = parsePath(text, this.stage.frame());
    this.keyframes = keyframes;
    if (seconds) this.seconds.value = String(Math.min(600, Math.max(1, Math.round(seconds))));
    this.update();
    this.stage.show(keyframes[0]);
  }

  private saveAs(name: string, format: (frames: ReturnType<typeof pathFrames>) => string): void {
    if (!this.rate.checkValidity()) throw new Error('Pictures a second are from 1 to 120.');
    const frames = pathFrames(this.keyframes, Math.round(this.duration() * this.rate.valueAsNumber));
    save(new Blob([format(frames)], { type: 'application/json' }), name);
    this.message.textContent = `Saved, ${frames.length} pictures.`;
  }

  /** Brings list and buttons up to date. */
  private update(isPlaying = false): void {
    const button = (text: string, label: string, action: () => void) => {
      const made = Object.assign(document.createElement('button'), {
        type: 'button',
        textContent: text,
        ariaLabel: label,
      });
      made.addEventListener('click', () => this.attempt(action));
      return made;
    };
    this.list.replaceChildren(
      ...this.keyframes.map((view, i) => {
        const item = document.createElement('li');
        item.append(
          button('Go to', `Go to keyframe ${i + 1}`, () => this.stage.show(view)),
          button('Remove', `Remove keyframe ${i + 1}`, () => {
            this.keyframes.splice(i, 1);
            this.update();
            element('add-keyframe').focus(); // the button that had the focus is gone
          }),
        );
        return item;
      }),
    );
    const enable = (ids: string[], on: boolean) => ids.forEach((id) => (element<HTMLButtonElement>(id).disabled = !on));
    enable(['play-turntable', 'record-turntable', 'add-keyframe', 'load-path'], !isPlaying);
    enable(['play-path', 'record-path'], !isPlaying && this.keyframes.length > 1);
    enable(['save-cameras', 'save-nerfstudio'], !isPlaying && this.keyframes.length > 0);
    enable(['stop-film'], isPlaying);
  }
}
