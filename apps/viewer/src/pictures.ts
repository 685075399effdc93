// SPDX-License-Identifier: Apache-2.0
// Saves pictures of the model, times its frames, and gives tests its pixels. Nothing else is drawn
// meanwhile.

import { runBenchmark, type BenchmarkResult } from './benchmark';
import type { Navigator } from './camera/navigator';
import type { View } from './camera/view';
import type { Scene } from './format/ngsplat';
import type { Vector } from './format/vector';
import { depthOf, type Mode } from './render/prepass';
import type { Picture, SceneRenderer } from './render/scene_renderer';
import type { Precision } from './render/target';
import { save } from './ui/elements';

/** The model of a page. */
export interface Subject {
  name: string;
  title: string;
  scene: Scene;
  navigator: Navigator;
  /** Nothing of it is still on its way. */
  isComplete: boolean;
}

/** What pictures need of the page. */
export interface PicturedPage {
  /** What is shown. Throws where there is no model. */
  model(): Subject;
  renderer(): SceneRenderer;
  /** Aborted when another model comes, or none. */
  signal(): AbortSignal;
  /** Brings the order of the Gaussians up to date for a view. */
  sort(view: View): Promise<void>;
  /** How a part of the model's picture is drawn, in a test view or elsewhere. */
  picture(mode: Mode, testView: number | undefined): Picture;
  /** Draws what the canvas is to show. */
  drawView(view: View, testView: number | undefined): void;
  redraw(): void;
}

/** Rgba bytes from the upper left. */
export interface Pixels {
  width: number;
  height: number;
  pixels: Uint8Array;
}

/** A place of the picture shows something where it is covered by this share. */
const LEAST_COVERED = 0.3;

export class Pictures {
  /** Something needs the model as it is. */
  isReserved = false;

  constructor(private readonly page: PicturedPage) {}

  /** The order that `work` sorts for stays: nothing else is drawn meanwhile. */
  private async reserve<T>(work: (model: Subject) => Promise<T>): Promise<T> {
    if (this.isReserved) throw new Error('another one is running');
    const model = this.page.model();
    this.isReserved = true;
    try {
      return await work(model);
    } finally {
      this.isReserved = false;
      this.page.redraw();
    }
  }

  /** Saves the picture as it is on the screen, as PNG. Returns what was saved, in words. */
  async save(): Promise<string> {
    const { page } = this;
    const { blob, title, view } = await this.reserve(async (model) => {
      const { navigator, title } = model;
      const { canvas } = page.renderer();
      const view = navigator.view(canvas.width, canvas.height);
      await page.sort(view);
      if (page.model() !== model) throw new Error('Another model has come meanwhile.');
      page.drawView(view, navigator.pinned);
      // Asked for before anything else runs: the browser clears the canvas when it has shown it.
      return { title, view, blob: await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve)) };
    });
    if (!blob) throw new Error('The browser cannot make a PNG file of this size.');
    save(blob, `${title}.png`);
    return `Saved, ${view.width} × ${view.height} pixels.`;
  }

  private async pixels(view: View, mode: Mode, testView: number | undefined, precision: Precision): Promise<Pixels> {
    await this.page.sort(view);
    return {
      width: view.width,
      height: view.height,
      pixels: await this.page.renderer().renderPixels(view, this.page.picture(mode, testView), precision),
    };
  }

  /** A test view at its own size and pose. */
  testViewPixels(index: number, mode: Mode, precision = this.page.renderer().precision): Promise<Pixels> {
    return this.reserve(({ scene }) => this.pixels(scene.testCameras[index], mode, index, precision));
  }

  /** The same from any pose: world from camera as in a test view, with its size and intrinsics. */
  viewPixels(view: View, mode: Mode, precision = this.page.renderer().precision): Promise<Pixels> {
    return this.reserve(() => this.pixels(view, mode, undefined, precision));
  }

  /**
   * The point that is seen at a place of the picture, given as shares of its width and height; undefined where there is
   * little to see.
   */
  async pointAt(x: number, y: number): Promise<Vector | undefined> {
    return this.reserve(async ({ navigator, scene }) => {
      const renderer = this.page.renderer();
      const { canvas } = renderer;
      const whole = navigator.view(canvas.width, canvas.height);
      const [u, v] = [x * whole.width, y * whole.height];
      // A picture of one pixel, drawn in the order of the whole one: on black and on white, which tells how much covers
      // it.
      const pixel = { ...whole, cx: whole.cx - u + 0.5, cy: whole.cy - v + 0.5, width: 1, height: 1 };
      const onBackground = async (grey: number) =>
        (
          await renderer.renderPixels(pixel, {
            ...this.page.picture('depth', undefined),
            background: [grey, grey, grey],
          })
        )[0] / 255;
      const onBlack = await onBackground(0);
      const covered = 1 - (await onBackground(1)) + onBlack;
      const depth = depthOf(scene, pixel, onBlack / covered);
      if (!(covered >= LEAST_COVERED && depth < Infinity)) return undefined;
      const [right, down] = [(u - whole.cx) / whole.fx, (v - whole.cy) / whole.fy];
      return whole.position.map(
        (p, i) => p + depth * (whole.forward[i] + right * whole.right[i] + down * whole.down[i]),
      ) as Vector;
    });
  }

  /** Which way the page draws. */
  get way(): SceneRenderer['way'] {
    return this.page.renderer().way;
  }

  /** The order in which a test view's Gaussians are drawn. */
  testViewOrder(index: number): Promise<Uint32Array> {
    return this.reserve(async ({ scene }) => {
      const renderer = this.page.renderer();
      await this.pixels(scene.testCameras[index], 'full', index, renderer.precision);
      return renderer.order();
    });
  }

  /** Frame times over the test views. `progress` goes from 0 to 1. */
  async benchmark(framesPerView: number, progress: (part: number) => void = () => undefined): Promise<BenchmarkResult> {
    const { page } = this;
    if (!page.model().isComplete) throw new Error('the model is still on its way');
    return this.reserve(({ name, scene, navigator }) =>
      runBenchmark(
        page.renderer(),
        scene,
        navigator.current(),
        name,
        (view) => page.sort(view),
        framesPerView,
        progress,
        page.signal(),
      ),
    );
  }
}
