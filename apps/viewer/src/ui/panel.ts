// SPDX-License-Identifier: Apache-2.0
// The settings beside the picture.

import type { MovementName } from '../camera/navigator';
import type { Scene } from '../format/ngsplat';
import type { Mode } from '../render/prepass';
import { element, onChoice } from './elements';
import { megabytes } from './notice';

const MODE_HELP: Record<Mode, string> = {
  full: 'The picture as gsapp renders it.',
  base: 'Every Gaussian in the colour that all directions share.',
  residual: 'How far each Gaussian’s colour is from its base, on black.',
  depth: 'Near is white.',
  appearance: 'Grey: one colour from everywhere. Blue to yellow: how much the colour depends on the view.',
};
const KEYS: Record<MovementName, string> = {
  orbit: 'Drag to turn, wheel or pinch to come closer, right button or two fingers to shift. Keys: arrows, + and −, Shift with arrows.',
  fly: 'Drag to look, two fingers to move. Keys: W A S D, Q and E, arrows.',
};

export interface PanelEvents {
  mode(mode: Mode): void;
  /** A test view, or undefined to move on from where the camera is. */
  camera(index: number | undefined): void;
  movement(name: MovementName): void;
  photometric(on: boolean): void;
}

export class Panel {
  private readonly camera = element<HTMLSelectElement>('camera');
  numViews = 0;

  constructor(events: PanelEvents) {
    const help = (mode: Mode) => (element('mode-help').textContent = MODE_HELP[mode]);
    const keys = (name: MovementName) => (element('keys').textContent = KEYS[name]);
    onChoice<Mode>('mode', (mode) => (help(mode), events.mode(mode)));
    onChoice<MovementName>('movement', (name) => (keys(name), events.movement(name)));
    help('full');
    keys('orbit');

    const chosen = () => events.camera(this.camera.value === '' ? undefined : Number(this.camera.value));
    this.camera.addEventListener('change', chosen);
    const step = (by: number) => {
      const at = this.camera.value === '' ? (by > 0 ? -1 : 0) : Number(this.camera.value);
      this.camera.value = String((at + by + this.numViews) % this.numViews);
      chosen();
    };
    element('previous').addEventListener('click', () => step(-1));
    element('next').addEventListener('click', () => step(1));
    const photometric = element<HTMLInputElement>('photometric');
    photometric.addEventListener('change', () => events.photometric(photometric.checked));

    const toggle = element('toggle');
    const fold = (folded: boolean) => {
      document.body.classList.toggle('folded', folded);
      toggle.textContent = folded ? 'Settings' : 'Hide';
      toggle.setAttribute('aria-expanded', String(!folded));
    };
    toggle.addEventListener('click', () => fold(!document.body.classList.contains('folded')));
    fold(matchMedia('(max-width: 44rem)').matches);
  }

  setName(name: string): void {
    element('name').textContent = name;
    document.title = `${name} – gsapp viewer`;
  }

  setScene(name: string, scene: Scene): void {
    this.setName(name);
    this.numViews = scene.testCameras.length;
    this.camera.replaceChildren(new Option('Free', ''), ...scene.testCameras.map((_, i) => new Option(`Test view ${i + 1}`, String(i))));
    for (const id of ['camera', 'previous', 'next']) element<HTMLButtonElement>(id).disabled = this.numViews === 0;
    element('photometric-row').hidden = !scene.photometric;
  }

  setCamera(pinned: number | undefined): void {
    this.camera.value = pinned === undefined ? '' : String(pinned);
  }

  setInfo(rows: [string, string][]): void {
    element('info').replaceChildren(
      ...rows.flatMap(([term, value]) => {
        const dt = document.createElement('dt'), dd = document.createElement('dd');
        dt.textContent = term;
        dd.textContent = value;
        return [dt, dd];
      }),
    );
  }
}

/** What is known of a model. */
export function sceneInfo(scene: Scene, fileBytes: number, gpuBytes: number): [string, string][] {
  const share = scene.payload.length > 0 ? scene.numResiduals / scene.count : 0;
  const words = scene.payload.reduce((sum, block) => sum + share * block.words * block.layers, 4);
  return [
    ['Gaussians', scene.count.toLocaleString('en')],
    ['Appearance', scene.appearance],
    ...(share > 0 && share < 1 ? [['View-dependent', `${(100 * share).toFixed(1)} %`]] as [string, string][] : []),
    ['Bytes per Gaussian', share < 1 ? (4 * words).toFixed(1) : String(4 * words)],
    ['File', megabytes(fileBytes)],
    ['Graphics memory', megabytes(gpuBytes)],
    ['Test views', String(scene.testCameras.length)],
    ...(scene.psnr ? [['Their PSNR', `${scene.psnr.model.toFixed(2)} dB`], ['As stored here', `${scene.psnr.packed.toFixed(2)} dB`]] as [string, string][] : []),
  ];
}
