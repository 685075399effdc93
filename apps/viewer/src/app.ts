// SPDX-License-Identifier: Apache-2.0
// The page: one renderer, at most one model, and what the user asked to see of it.

import { runBenchmark, type BenchmarkResult } from './benchmark';
import { Navigator, type MovementName } from './camera/navigator';
import type { View } from './camera/view';
import { Comparison } from './compare/comparison';
import { fetchSite, SITE_FILE } from './compare/site';
import { FormatError } from './format/cursor';
import { readAll, type Source } from './format/load';
import { parseScene, type Scene } from './format/ngsplat';
import type { Mode } from './render/prepass';
import { Renderer, type Picture } from './render/renderer';
import { sceneCenters, SortClient } from './sort/sort_client';
import { BenchmarkPanel } from './ui/benchmark_panel';
import { element } from './ui/elements';
import { Meter } from './ui/meter';
import { hideNotice, showError, showLoading } from './ui/notice';
import { Panel, sceneInfo } from './ui/panel';

/** More pixels than this per CSS pixel are not seen, but paid for. */
const MOST_DEVICE_PIXELS = 2;

interface Loaded {
  name: string;
  scene: Scene;
  navigator: Navigator;
  sorter?: SortClient;
}

/** Equal where the order is. */
const poseKey = (view: View): string => JSON.stringify([view.position, view.forward]);

export class App {
  private readonly canvas = element<HTMLCanvasElement>('canvas');
  private readonly renderer = new Renderer(this.canvas);
  private readonly panel: Panel;
  private readonly benchmarkPanel = new BenchmarkPanel((frames, progress) => this.benchmark(frames, progress));
  private readonly meter = new Meter();
  private readonly comparison = new Comparison(this.renderer, () => this.redraw());
  private loaded: Loaded | undefined;
  private loading = new AbortController();
  private mode: Mode = 'full';
  private photometric = true;
  private movement: MovementName = 'orbit';
  private sortedFor = '';
  private scheduled = false;
  private isReserved = false;

  constructor() {
    this.panel = new Panel({
      mode: (mode) => (this.mode = mode, this.redraw()),
      photometric: (on) => (this.photometric = on, this.redraw()),
      movement: (name) => {
        this.movement = name;
        this.loaded?.navigator.setMovement(name);
      },
      camera: (index) => {
        if (index === undefined) this.loaded?.navigator.unpin();
        else this.loaded?.navigator.pin(index);
        this.redraw();
      },
    });
    this.canvas.addEventListener('webglcontextlost', () => this.fail('The graphics device was lost', 'Often its memory ran out. Reload the page; a smaller model may help.'));
    const resize = () => {
      const scale = Math.min(devicePixelRatio, MOST_DEVICE_PIXELS);
      this.renderer.webgl.setSize(Math.max(1, Math.round(scale * this.canvas.clientWidth)), Math.max(1, Math.round(scale * this.canvas.clientHeight)), false);
      this.draw(); // at once: setting the size has cleared the picture
    };
    new ResizeObserver(resize).observe(this.canvas);
    addEventListener('resize', resize); // another density of the screen may become known after the size
  }

  private fail(title: string, message: string): void {
    showError(title, message, this.loaded !== undefined);
  }

  /** Reads and shows a file. What fails is said on the page; what was there before stays where the file could not be read. */
  async open(source: Source | ((signal: AbortSignal) => Promise<Source>)): Promise<void> {
    this.loading.abort();
    const { signal } = (this.loading = new AbortController());
    let name = 'the model';
    try {
      const { name: found, size, stream } = typeof source === 'function' ? await source(signal) : source;
      name = found;
      showLoading(name, 0, size);
      const buffer = await readAll({ name, size, stream }, (bytes) => {
        signal.throwIfAborted();
        showLoading(name, bytes, size);
      });
      signal.throwIfAborted();
      const scene = parseScene(buffer);
      hideNotice(); // before drawing, which may have something to say
      this.show(name, scene, buffer.byteLength);
    } catch (error) {
      if (signal.aborted) return; // another file is on its way
      this.fail(error instanceof FormatError ? `${name} cannot be read` : `${name} cannot be shown`, (error as Error).message);
    }
  }

  private unload(): void {
    this.loaded?.navigator.dispose();
    this.loaded?.sorter?.dispose();
    this.loaded = undefined;
    this.renderer.clearScene();
    this.comparison.setScene(undefined);
    document.body.classList.remove('loaded');
  }

  private show(name: string, scene: Scene, bytes: number): void {
    this.unload(); // first, so that both need not fit into memory
    const centers = sceneCenters(scene);
    this.renderer.setScene(scene);
    document.body.classList.add('loaded');
    this.comparison.setScene(scene);
    const navigator = new Navigator(scene, this.canvas, () => this.redraw());
    navigator.setMovement(this.movement);
    const apply = (order: Uint32Array, count: number) => {
      this.redraw();
      return this.renderer.setOrder(order, count);
    };
    const sorter = scene.count ? new SortClient(centers, apply, (message) => this.fail('Sorting failed', message)) : undefined;
    this.loaded = { name, scene, navigator, sorter };
    this.sortedFor = '';
    this.panel.setScene(scene.name ?? name, scene);
    this.panel.setInfo(sceneInfo(scene, bytes, this.renderer.bytes));
    this.benchmarkPanel.clear();
    this.draw();
  }

  private redraw(): void {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.draw();
    });
  }

  private picture(mode: Mode, testView: number | undefined, scene = this.loaded!.scene): Picture {
    const { photometric } = scene;
    const exposure = this.photometric && photometric ? (testView === undefined ? photometric.neutral : photometric.testViews[testView]) : undefined;
    const ownColors = mode === 'full' || mode === 'base';
    return { mode, background: ownColors ? scene.background : [0, 0, 0], exposure: ownColors ? exposure : undefined };
  }

  private sort(view: View): Promise<void> {
    this.sortedFor = poseKey(view);
    return this.loaded!.sorter?.sort({ position: view.position, forward: view.forward }) ?? Promise.resolve();
  }

  private draw(): void {
    if (!this.loaded || this.isReserved) return;
    const { navigator, sorter } = this.loaded;
    const view = navigator.view(this.canvas.width, this.canvas.height);
    if (poseKey(view) !== this.sortedFor) void this.sort(view);
    this.panel.setCamera(navigator.pinned);
    try {
      if (this.comparison.isOn) this.comparison.draw(view, navigator.pinned, (mode, scene) => this.picture(mode, navigator.pinned, scene));
      else this.renderer.render(view, this.picture(this.mode, navigator.pinned));
      this.meter.frame(performance.now(), sorter?.milliseconds ?? 0, this.renderer.drawn);
    } catch (error) {
      this.unload();
      this.fail('This model cannot be drawn', (error as Error).message);
    }
  }

  /** The order that `work` sorts for stays: nothing else is drawn meanwhile. */
  private async reserve<T>(work: (loaded: Loaded) => Promise<T>): Promise<T> {
    if (!this.loaded || this.isReserved) throw new Error(this.loaded ? 'another one is running' : 'no model is loaded');
    this.isReserved = true;
    try {
      return await work(this.loaded);
    } finally {
      this.isReserved = false;
      this.redraw();
    }
  }

  /** Where the model shown came from beside the page: what else lies there. */
  async readSite(): Promise<void> {
    const { loaded } = this;
    if (!loaded?.scene.hasSite) return;
    try {
      const site = await fetchSite(loaded.scene.testCameras.length);
      if (loaded === this.loaded) this.comparison.setSite(site);
    } catch (error) {
      this.fail(`${SITE_FILE} cannot be read`, (error as Error).message);
    }
  }

  /** A test view at its own size and pose: rgba bytes from the upper left. */
  testViewPixels(index: number, mode: Mode, precision = this.renderer.precision): Promise<{ width: number; height: number; pixels: Uint8Array }> {
    return this.reserve(async ({ scene }) => {
      const view = scene.testCameras[index];
      await this.sort(view);
      return { width: view.width, height: view.height, pixels: this.renderer.renderPixels(view, this.picture(mode, index), precision) };
    });
  }

  benchmark(framesPerView: number, progress: (part: number) => void = () => undefined): Promise<BenchmarkResult> {
    return this.reserve(({ name, scene }) =>
      runBenchmark(this.renderer, scene, name, (view) => this.sort(view), framesPerView, progress, this.loading.signal));
  }
}
