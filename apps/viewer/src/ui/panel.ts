// SPDX-License-Identifier: Apache-2.0
// The settings beside the picture.

import { colorOf, hexColor } from '../address';
import type { AxisName, MovementName } from '../camera/navigator';
import type { Scene } from '../format/ngsplat';
import type { Vector } from '../format/vector';
import { PAGE } from '../page';
import type { Mode } from '../render/prepass';
import type { Settings } from '../settings';
import { element, fillList, onChoice } from './elements';
import { megabytes } from './notice';

const MODE_HELP: Record<Mode, string> = {
  full: 'The picture as gsapp renders it.',
  base: 'Every Gaussian in the colour that all directions share.',
  residual: 'How far each Gaussian’s colour is from its base, on black.',
  depth: 'Near is white.',
  appearance: 'Grey: one colour from everywhere. Blue to yellow: how much the colour depends on the view.',
};
const KEYS: Record<MovementName, string> = {
  orbit:
    'Drag to turn, wheel or pinch to come closer, right button or two fingers to shift, double click to turn around another point. Keys: arrows, + and −, Shift with arrows.',
  fly: 'Drag to look, two fingers to move, wheel for the speed. Keys: W A S D, Q and E, arrows.',
};

export interface PanelEvents {
  /** The user changed some of the settings. */
  change(settings: Partial<Settings>): void;
  /** A test view, or undefined to move on from where the camera is. */
  camera(index: number | undefined): void;
  frame(): void;
  reset(): void;
  copyLink(): Promise<string>;
  savePicture(): Promise<string>;
}

/** The page of a training is for who trains; others begin with the picture alone. */
const startsOpen = new URLSearchParams(location.search).has('live') && !matchMedia('(max-width: 44rem)').matches;

const radio = (group: string, value: string) =>
  document.querySelector<HTMLInputElement>(`input[name="${group}"][value="${value}"]`)!;
const short = (x: number): string => String(Number(x.toPrecision(3)));

export class Panel {
  private readonly camera = element<HTMLSelectElement>('camera');
  private readonly up = element<HTMLSelectElement>('up');
  private readonly toggle = element('toggle');
  private readonly background = element<HTMLInputElement>('background');
  private readonly splatSize = element<HTMLInputElement>('splat-size');
  private readonly near = element<HTMLInputElement>('near');
  private readonly points = element<HTMLInputElement>('points');
  private readonly photometric = element<HTMLInputElement>('photometric');
  numViews = 0;
  private ownBackground: Vector = [0, 0, 0];

  constructor(events: PanelEvents) {
    onChoice<Mode>('mode', (mode) => events.change({ mode }));
    onChoice<MovementName>('movement', (movement) => events.change({ movement }));
    this.up.addEventListener('change', () =>
      events.change({ up: (this.up.value || undefined) as AxisName | undefined }),
    );
    this.background.addEventListener('input', () =>
      events.change({ background: colorOf(this.background.value.slice(1)) }),
    );
    element('own-background').addEventListener('click', () => {
      this.background.focus(); // the button is disabled at once
      events.change({ background: undefined });
    });
    this.splatSize.addEventListener('input', () => events.change({ splatSize: this.splatSize.valueAsNumber }));
    this.points.addEventListener('change', () => events.change({ points: this.points.checked }));
    this.near.addEventListener('input', () => events.change({ near: this.near.valueAsNumber }));
    this.photometric.addEventListener('change', () => events.change({ photometric: this.photometric.checked }));
    element('frame').addEventListener('click', events.frame);
    element('reset').addEventListener('click', events.reset);
    const said = (work: () => Promise<string>) => async () => {
      element('picture-message').textContent = await work().catch((error: Error) => error.message);
    };
    element('copy-link').addEventListener('click', said(events.copyLink));
    element('save-picture').addEventListener('click', said(events.savePicture));

    const chosen = () => events.camera(this.camera.value === '' ? undefined : Number(this.camera.value));
    this.camera.addEventListener('change', chosen);
    const step = (by: number) => {
      const at = this.camera.value === '' ? (by > 0 ? -1 : 0) : Number(this.camera.value);
      this.camera.value = String((at + by + this.numViews) % this.numViews);
      chosen();
    };
    element('previous').addEventListener('click', () => step(-1));
    element('next').addEventListener('click', () => step(1));

    this.toggle.addEventListener('click', () => {
      const open = document.body.classList.contains('folded');
      events.change({ panel: open === startsOpen ? undefined : open });
    });
  }

  /** Brings the controls to what is set. */
  show(settings: Settings): void {
    const { mode, movement, up, background, splatSize, points, near, photometric, panel } = settings;
    const isOpen = panel ?? startsOpen;
    document.body.classList.toggle('folded', !isOpen);
    this.toggle.textContent = isOpen ? 'Hide' : 'Settings';
    this.toggle.ariaExpanded = String(isOpen);
    this.up.value = up ?? '';
    radio('mode', mode).checked = radio('movement', movement).checked = true;
    element('mode-help').textContent = MODE_HELP[mode];
    element('keys').textContent = KEYS[movement];
    this.background.value = `#${hexColor(background ?? this.ownBackground)}`;
    element<HTMLButtonElement>('own-background').disabled = background === undefined;
    this.splatSize.value = String(splatSize);
    this.splatSize.disabled = points;
    element('splat-size-value').textContent = short(splatSize);
    this.points.checked = points;
    this.near.value = String(near);
    element('near-value').textContent = short(near);
    this.photometric.checked = photometric;
  }

  /** What the end of a file says. */
  setEnd(name: string, { background, areTrainingViews }: Scene): void {
    element('name').textContent = name;
    document.title = name === PAGE.title ? name : `${name} – gsapp viewer`;
    this.ownBackground = background;
    const kind = areTrainingViews ? 'Training view' : 'Test view';
    for (const option of this.camera.options)
      if (option.value !== '') option.textContent = `${kind} ${Number(option.value) + 1}`;
  }

  setScene(name: string, scene: Scene): void {
    this.near.max = String(2 * scene.distance || 1);
    element('picture-message').textContent = '';
    this.numViews = scene.testCameras.length;
    this.camera.replaceChildren(new Option('Free', ''), ...scene.testCameras.map((_, i) => new Option('', String(i))));
    this.setEnd(name, scene);
    for (const id of ['camera', 'previous', 'next']) element<HTMLButtonElement>(id).disabled = this.numViews === 0;
    element('photometric-row').hidden = !scene.photometric;
  }

  setCamera(pinned: number | undefined): void {
    this.camera.value = pinned === undefined ? '' : String(pinned);
  }

  setInfo(rows: [string, string][]): void {
    fillList('info', rows);
  }
}

/** What is known of a model. */
export function sceneInfo(scene: Scene, fileBytes: number, gpuBytes: number): [string, string][] {
  const share = scene.payload.length > 0 ? scene.numResiduals / scene.count : 0;
  const words = scene.payload.reduce((sum, block) => sum + share * block.words * block.layers, 4);
  return [
    ['Gaussians', scene.count.toLocaleString('en')],
    ['Appearance', scene.appearance],
    ...(share > 0 && share < 1 ? ([['View-dependent', `${(100 * share).toFixed(1)} %`]] as [string, string][]) : []),
    ['Bytes per Gaussian', share < 1 ? (4 * words).toFixed(1) : String(4 * words)],
    ['File', megabytes(fileBytes)],
    ['Graphics memory', megabytes(gpuBytes)],
    [scene.areTrainingViews ? 'Training views' : 'Test views', String(scene.testCameras.length)],
    ...(scene.psnr
      ? ([
          ['Their PSNR', `${scene.psnr.model.toFixed(2)} dB`],
          ['As stored here', `${scene.psnr.packed.toFixed(2)} dB`],
        ] as [string, string][])
      : []),
  ];
}
