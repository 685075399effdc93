// SPDX-License-Identifier: Apache-2.0
// The page: one renderer, at most one model, and what the user asked to see of it.

import { runBenchmark, type BenchmarkResult } from './benchmark';
import { Navigator, type MovementName } from './camera/navigator';
import type { View } from './camera/view';
import { Comparison } from './compare/comparison';
import { fetchSite, SITE_FILE, type Site } from './compare/site';
import { FormatError } from './format/cursor';
import { inSteps, peekHead, readAll, readParts, type Source } from './format/load';
import { isNgsplat } from './format/import';
import type { Scene } from './format/ngsplat';
import { SceneCollector, SceneReader, texelsOf, type Plane } from './format/reader';
import { convertScene } from './format/convert_scene';
import type { Mode } from './render/prepass';
import { Renderer, type Picture } from './render/renderer';
import { SortClient } from './sort/sort_client';
import { BenchmarkPanel } from './ui/benchmark_panel';
import { element } from './ui/elements';
import { Meter } from './ui/meter';
import { hideNotice, showError, showLoading } from './ui/notice';
import { Panel, sceneInfo } from './ui/panel';

/** More pixels than this per CSS pixel are not seen, but paid for. */
const MOST_DEVICE_PIXELS = 2;

/** Milliseconds between two pictures of a model that is on its way. */
const REFRESH = 200;

interface Loaded {
  name: string;
  /** Nothing of it is still on its way. */
  isComplete: boolean;
  scene: Scene;
  navigator: Navigator;
  sorter?: SortClient;
}

/** Equal where the order is. */
const poseKey = ({ position, right, forward, fx, fy, cx, cy, width, height }: View): string => JSON.stringify([position, right, forward, fx, fy, cx, cy, width, height]);

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
  /** A newer state of the model is there, but not yet its order: the picture before stays. */
  private awaitsOrder = false;
  private refreshing: ReturnType<typeof setTimeout> | undefined;

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

  /**
   * Reads and shows a file. Where nothing is shown, what has arrived of it is, and is taken away again if the rest is not what it should be;
   * else what was there before stays until the file is there as a whole, also where it cannot be read. What fails is said on the page.
   */
  async open(source: Source | ((signal: AbortSignal) => Promise<Source>)): Promise<void> {
    this.loading.abort();
    const { signal } = (this.loading = new AbortController());
    this.dropPart();
    let name = 'the model';
    try {
      const found = typeof source === 'function' ? await source(signal) : source;
      name = found.name;
      showLoading(name, 0, found.size);
      const { head, source: whole } = await peekHead(found);
      signal.throwIfAborted();
      if (isNgsplat(name, head)) await this.openPacked(whole, signal);
      else await this.openOther(whole, signal);
    } catch (error) {
      if (signal.aborted) return; // another file is on its way
      this.dropPart();
      this.fail(error instanceof FormatError ? `${name} cannot be read` : `${name} cannot be shown`, (error as Error).message);
    }
  }

  private async openPacked(source: Source, signal: AbortSignal): Promise<void> {
    const { name, size } = source, collector = this.loaded && new SceneCollector();
    const reader = new SceneReader(collector ?? { begin: (scene) => this.begin(name, scene), rows: (...part) => this.addRows(...part) }, size);
    await readParts(source, (part) => {
      signal.throwIfAborted();
      reader.push(part);
      showLoading(name, reader.bytes, reader.end ?? size, this.loaded?.isComplete === false);
    });
    signal.throwIfAborted();
    const scene = reader.finish();
    if (collector) await this.show(name, scene, signal);
    this.complete(reader.bytes);
  }

  /** A file of another program, which is converted as a whole. */
  private async openOther(source: Source, signal: AbortSignal): Promise<void> {
    const { name, size } = source;
    const buffer = await readAll(source, (bytes) => {
      signal.throwIfAborted();
      showLoading(name, bytes, size);
    });
    const { byteLength } = buffer, { scene, remarks } = await convertScene(name, buffer, signal); // takes the bytes
    signal.throwIfAborted();
    await this.show(name, scene, signal);
    this.complete(byteLength);
    if (remarks.length > 0) showError(`About ${name}`, remarks.join(' '), true);
  }

  /** Shows a newer state of the same model; camera and settings stay. Returns whether it could. */
  async refresh(source: Source): Promise<boolean> {
    try {
      const reader = new SceneReader(new SceneCollector(), source.size);
      await readParts(source, (part) => reader.push(part));
      const scene = reader.finish(), keep = this.loaded?.navigator;
      await this.show(source.name, scene, new AbortController().signal, keep);
      this.complete(reader.bytes);
      return true;
    } catch (error) {
      if (!this.loaded) this.fail(`${source.name} cannot be shown`, (error as Error).message);
      return false;
    }
  }

  /** Unloads a model that never became complete. */
  private dropPart(): void {
    if (this.loaded && !this.loaded.isComplete) this.unload();
  }

  private unload(keep?: Navigator): void {
    if (!keep) this.loaded?.navigator.dispose();
    this.loaded?.sorter?.dispose();
    this.loaded = undefined;
    this.renderer.clearScene();
    if (keep) return;
    this.comparison.setScene(undefined);
    document.body.classList.remove('loaded');
  }

  /** Shows a scene that has its texels, and takes them out of it. With `keep`, the camera stays as it is. */
  private async show(name: string, scene: Scene, signal: AbortSignal, keep?: Navigator): Promise<void> {
    this.unload(keep); // first, so that both need not fit into memory
    this.begin(name, scene, keep);
    await inSteps(texelsOf(scene), (part) => {
      signal.throwIfAborted();
      this.addRows(...part);
    });
  }

  /** Shows a scene whose texels follow. */
  private begin(name: string, scene: Scene, keep?: Navigator): void {
    this.renderer.beginScene(scene);
    document.body.classList.add('loaded');
    if (keep) this.comparison.replaceScene(scene);
    else this.comparison.setScene(scene);
    const navigator = keep ?? new Navigator(scene, this.canvas, () => this.redraw());
    if (keep) keep.setScene(scene);
    else navigator.setMovement(this.movement);
    this.awaitsOrder = keep !== undefined && scene.count > 0;
    const apply = (order: Uint32Array, count: number) => {
      if (this.loaded?.isComplete) this.awaitsOrder = false;
      this.redraw();
      return this.renderer.setOrder(order, count);
    };
    const sorter = scene.count ? new SortClient(scene.count, apply, (message) => this.fail('Sorting failed', message)) : undefined;
    this.loaded = { name, isComplete: false, scene, navigator, sorter };
    this.sortedFor = '';
    if (this.panel.numViews !== scene.testCameras.length || !keep) this.panel.setScene(name, scene);
    if (!keep) this.panel.setInfo([]);
    this.benchmarkPanel.clear();
  }

  private addRows(plane: Plane, row: number, texels: Uint32Array): void {
    this.renderer.addRows(plane, row, texels);
    if (plane.block >= 0) return;
    this.loaded!.sorter?.add(texels);
    this.refreshing ??= setTimeout(() => {
      this.refreshing = undefined;
      this.sortedFor = '';
      this.redraw();
    }, REFRESH);
  }

  /** The scene has all its texels, and what the end of its file says. */
  private complete(bytes: number): void {
    const { name, scene } = this.loaded!;
    this.loaded!.isComplete = true;
    this.renderer.completeScene();
    this.sortedFor = '';
    this.panel.setName(scene.name ?? name);
    this.panel.setInfo(sceneInfo(scene, bytes, this.renderer.bytes));
    hideNotice(); // before drawing, which may have something to say
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
    return this.loaded!.sorter?.sort(view, this.renderer.growth) ?? Promise.resolve();
  }

  private draw(): void {
    if (!this.loaded || this.isReserved) return;
    const { navigator, sorter } = this.loaded;
    const view = navigator.view(this.canvas.width, this.canvas.height);
    if (poseKey(view) !== this.sortedFor) void this.sort(view);
    if (this.awaitsOrder) return;
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

  /** What lies beside the model. */
  setSite(site: Site): void {
    this.comparison.setSite(site);
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

  /** The same from any pose: world from camera as in a test view, with its size and intrinsics. */
  viewPixels(view: View, mode: Mode, precision = this.renderer.precision): Promise<{ width: number; height: number; pixels: Uint8Array }> {
    return this.reserve(async () => {
      await this.sort(view);
      return { width: view.width, height: view.height, pixels: this.renderer.renderPixels(view, this.picture(mode, undefined), precision) };
    });
  }

  benchmark(framesPerView: number, progress: (part: number) => void = () => undefined): Promise<BenchmarkResult> {
    if (this.loaded?.isComplete === false) return Promise.reject(new Error('the model is still on its way'));
    return this.reserve(({ name, scene }) =>
      runBenchmark(this.renderer, scene, name, (view) => this.sort(view), framesPerView, progress, this.loading.signal));
  }
}
