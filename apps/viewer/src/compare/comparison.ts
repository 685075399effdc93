// SPDX-License-Identifier: Apache-2.0
// Two pictures of one view beside a divider: parts of the model's picture, a photograph, or another model.

import type { View } from '../camera/view';
import type { Scene } from '../format/ngsplat';
import { Renderer } from '../render/renderer';
import type { Picture } from '../render/scene_renderer';
import { MODES, type Mode } from '../render/prepass';
import { ComparePanel, MODE_NAMES, type Compared, type Shown, type Sides } from '../ui/compare';
import { megabytes } from '../ui/notice';
import { Photograph } from './photograph';
import { SecondModel } from './second_model';
import type { Site } from './site';

const isMode = (shown: Shown): shown is Mode => (MODES as readonly string[]).includes(shown);

export class Comparison {
  private readonly panel: ComparePanel;
  private readonly photograph: Photograph;
  private renderer: Renderer | undefined;
  private secondRenderer: Renderer | undefined;
  private scene: Scene | undefined;
  private site: Site | undefined;
  private second: SecondModel | undefined;

  /** `changed` asks for another frame. */
  constructor(private readonly changed: () => void) {
    this.panel = new ComparePanel(changed);
    this.photograph = new Photograph(changed);
  }

  get isOn(): boolean {
    return this.panel.isOn;
  }

  /** What is compared; undefined while one picture is shown. */
  get compared(): Compared | undefined {
    return this.panel.compared;
  }

  set compared(compared: Compared | undefined) {
    this.panel.compared = compared;
  }

  /** The first model. Whatever belonged to another one is let go. */
  setScene(scene: Scene | undefined): void {
    this.scene = scene;
    this.site = undefined;
    this.second?.dispose();
    this.second = undefined;
    this.photograph.clear();
    this.panel.setOther(undefined);
  }

  /** A newer state of the first model. */
  replaceScene(scene: Scene): void {
    this.scene = scene;
  }

  /** What lies beside the model. */
  setSite(site: Site): void {
    this.site = site;
    this.panel.setOther(site.other?.name, site.other ? 'other' : site.photographs ? 'photograph' : undefined);
    this.changed();
  }

  /**
   * Draws both sides by the renderer of the first model. `pinned` is the test view that is shown exactly; `picture`
   * says how a part of a model's picture is drawn.
   */
  draw(
    renderer: Renderer,
    view: View,
    pinned: number | undefined,
    picture: (mode: Mode, scene: Scene) => Picture,
  ): void {
    if (this.renderer !== renderer) [this.renderer, this.secondRenderer] = [renderer, new Renderer(renderer)];
    const middle = Math.round(this.panel.split * view.width);
    const { left, right } = this.panel.sides;
    this.drawSide(left, [0, middle], view, pinned, picture);
    this.drawSide(right, [middle, view.width], view, pinned, picture);
    this.panel.setLabels(this.label(left, pinned), this.label(right, pinned));
    this.panel.setHelp(this.memory(this.panel.sides));
  }

  private drawSide(
    shown: Shown,
    [first, end]: [number, number],
    view: View,
    pinned: number | undefined,
    picture: (mode: Mode, scene: Scene) => Picture,
  ): void {
    const scene = this.scene!;
    const renderer = this.renderer!;
    const { webgl } = renderer;
    this.prepare(shown, pinned);
    renderer.within(first, end, view.height, () => {
      if (this.obstacle(shown, pinned) !== undefined) {
        webgl.setRenderTarget(null);
        webgl.setClearColor(0, 1);
        webgl.clear(true, false, false);
      } else if (shown === 'photograph') this.photograph.draw(webgl, scene.testCameras[pinned!], view);
      else if (shown === 'other') this.second!.draw(view, (other) => picture('full', other));
      else renderer.render(view, picture(shown, scene));
    });
  }

  /** Begins to fetch what is to be shown. */
  private prepare(shown: Shown, pinned: number | undefined): void {
    const { site, scene } = this;
    if (shown === 'other' && site?.other)
      this.second ??= new SecondModel(this.secondRenderer!, site.other.file, scene!.testCameras.length, this.changed);
    const path = shown === 'photograph' && pinned !== undefined ? site?.photographs?.[pinned] : undefined;
    if (path) this.photograph.show(path, scene!.testCameras[pinned!]);
  }

  /** Why this cannot be shown now; undefined where it can. */
  private obstacle(shown: Shown, pinned: number | undefined): string | undefined {
    if (isMode(shown)) return undefined;
    if (shown === 'other')
      return this.second ? this.second.obstacle : 'There is one model here. gsapp export RUN RUN writes two.';
    if (!this.site?.photographs) return 'There are no photographs here. gsapp export --photographs writes them.';
    if (pinned === undefined) return 'Choose a test view: only these have photographs.';
    if (!this.site.photographs[pinned]) return 'The photograph of this test view was not exported.';
    return this.photograph.obstacle;
  }

  private label(shown: Shown, pinned: number | undefined): string {
    const obstacle = this.obstacle(shown, pinned);
    const { site } = this;
    const name = isMode(shown)
      ? site?.other
        ? `${site.name}: ${MODE_NAMES[shown].toLowerCase()}`
        : MODE_NAMES[shown]
      : shown === 'photograph'
        ? 'Photograph'
        : (site?.other?.name ?? 'Other model');
    return obstacle === undefined ? name : `${name}. ${obstacle}`;
  }

  private memory({ left, right }: Sides): string {
    if (left !== 'other' && right !== 'other') return 'Drag the divider, or move it with the arrow keys.';
    const both = this.second?.bytes
      ? `: ${megabytes(this.renderer!.bytes)} and ${megabytes(this.second.bytes)} on the graphics device`
      : '';
    return `Both models are in memory${both}.`;
  }
}
