// SPDX-License-Identifier: Apache-2.0
// The page: one renderer, at most one model, and what the user asked to see of it.

import { AddressBar, formatAddress, parseAddress, type Address } from './address';
import { runBenchmark, type BenchmarkResult } from './benchmark';
import { CenterSample } from './camera/extent';
import { Navigator } from './camera/navigator';
import { turntable, type CameraPath } from './camera/path';
import type { View } from './camera/view';
import { FormatError } from './format/cursor';
import { readAll, type Source } from './format/load';
import { parseScene, type Scene } from './format/ngsplat';
import type { Mode } from './render/prepass';
import { Renderer, type Picture } from './render/renderer';
import { DEFAULTS, type Settings } from './settings';
import { sceneCenters, SortClient } from './sort/sort_client';
import { BenchmarkPanel } from './ui/benchmark_panel';
import { element, save } from './ui/elements';
import { FilmPanel } from './ui/film_panel';
import { toggleFullscreen } from './ui/fullscreen';
import { onKeys } from './ui/keys';
import { Meter } from './ui/meter';
import { hideNotice, showError, showLoading, showWelcome } from './ui/notice';
import { Panel, sceneInfo } from './ui/panel';
import { record } from './ui/recorder';

/** More pixels than this per CSS pixel are not seen, but paid for. */
const MOST_DEVICE_PIXELS = 2;

interface Loaded {
  name: string;
  /** What the model is called on the page. */
  title: string;
  scene: Scene;
  sample: CenterSample;
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
  private readonly film = new FilmPanel({
    view: () => this.model.navigator.current(),
    show: (view) => this.move((navigator) => navigator.showExactly(view)),
    turntable: () => turntable(this.model.navigator.current(), this.model.navigator.target, this.model.scene.up),
    frame: () => this.model.scene.frame,
    play: (path, seconds) => this.play(path, seconds),
    record: (path, seconds) => record(this.canvas, () => this.play(path, seconds)),
    stop: () => this.playing.abort(),
  });
  private playing = new AbortController();
  private readonly meter = new Meter();
  private loaded: Loaded | undefined;
  private loading = new AbortController();
  private settings: Settings = { ...DEFAULTS };
  private readonly address = new AddressBar(() => this.fragment());
  /** The fragment that the next model is shown with. */
  private begin: string | undefined = location.hash;
  /** Opens the model again that is shown, and whether its address does so elsewhere. */
  private again: { open: () => Promise<void>; inAddress: boolean } | undefined;
  private sortedFor = '';
  private scheduled = false;
  private isReserved = false;

  constructor() {
    this.panel = new Panel({
      change: (settings) => this.change(settings),
      camera: (index) => this.move((navigator) => (index === undefined ? navigator.unpin() : navigator.pin(index))),
      frame: this.frame, reset: this.reset, copyLink: () => this.copyLink(), savePicture: () => this.savePicture(),
    });
    this.panel.show(this.settings);
    const saved = () => void this.savePicture().catch((error: Error) => this.fail('The picture cannot be saved', error.message));
    onKeys(this.canvas, { f: this.frame, r: this.reset, x: toggleFullscreen, p: saved, k: () => this.loaded && this.film.add() }, () => this.playing.abort());
    for (const event of ['pointerdown', 'wheel', 'keydown']) this.canvas.addEventListener(event, () => this.playing.abort());
    addEventListener('hashchange', (event) => {
      const { hash } = new URL(event.newURL); // the address may have been brought up to date since
      if (this.loaded) this.apply(hash);
      else this.begin = hash;
    });
    this.canvas.addEventListener('webglcontextlost', () => this.lose());
    this.canvas.addEventListener('webglcontextrestored', () => void this.restore());
    const resize = () => {
      const scale = Math.min(devicePixelRatio, MOST_DEVICE_PIXELS);
      this.renderer.webgl.setSize(Math.max(1, Math.round(scale * this.canvas.clientWidth)), Math.max(1, Math.round(scale * this.canvas.clientHeight)), false);
      this.draw(); // at once: setting the size has cleared the picture
    };
    new ResizeObserver(resize).observe(this.canvas);
    addEventListener('resize', resize); // another density of the screen may become known after the size
  }

  private change(settings: Partial<Settings>): void {
    const { movement } = this.settings;
    Object.assign(this.settings, settings);
    if (this.settings.movement !== movement) this.loaded?.navigator.setMovement(this.settings.movement);
    this.panel.show(this.settings);
    this.redraw();
  }

  private move(how: (navigator: Navigator, loaded: Loaded) => void): void {
    if (this.loaded) how(this.loaded.navigator, this.loaded);
    this.redraw();
  }

  private readonly frame = () => this.move((navigator, { sample }) => navigator.frame(sample.extent()));
  private readonly reset = () => this.move((navigator) => navigator.reset());

  /** What the address says of the picture. */
  private state(): Address {
    const { settings } = this, navigator = this.loaded?.navigator;
    if (!navigator || navigator.isFirst || navigator.pinned === 0) return { settings };
    return { settings, camera: navigator.pinned === undefined ? { from: navigator.current().position, to: navigator.target, fov: navigator.fov } : { view: navigator.pinned } };
  }

  private fragment(): string {
    return formatAddress(this.state(), this.loaded?.scene.distance ?? 1);
  }

  /** Shows what a fragment says, as far as this model has it. */
  private apply(fragment: string): void {
    const { settings, camera } = parseAddress(fragment);
    this.change(settings);
    this.move((navigator, { scene }) => {
      if (camera && 'from' in camera) navigator.look(camera.from, camera.to, camera.fov);
      else if (camera && camera.view < scene.testCameras.length) navigator.pin(camera.view);
      else navigator.reset();
    });
  }

  private get model(): Loaded {
    if (!this.loaded) throw new Error('There is no model yet.');
    return this.loaded;
  }

  /** Shows a path in its time, until the user moves or stops it, or another model comes. */
  private async play(path: CameraPath, seconds: number): Promise<void> {
    this.playing.abort();
    const { signal } = (this.playing = new AbortController()), { navigator } = this.model, begin = performance.now();
    for (let time = 0; !signal.aborted && this.loaded?.navigator === navigator; ) {
      navigator.showExactly(path(time));
      this.draw();
      if (time === 1) return;
      await new Promise(requestAnimationFrame);
      time = Math.min(1, (performance.now() - begin) / 1000 / seconds);
    }
  }

  private async copyLink(): Promise<string> {
    this.address.write();
    const file = this.again?.inAddress ? '' : ' It cannot hold the file that you opened: put that on a web server, and its address behind ?model=.';
    try {
      await navigator.clipboard.writeText(location.href);
    } catch {
      return `The browser does not allow copying; the link is the address of this page.${file}`;
    }
    return `Copied.${file}`;
  }

  /** The picture as it is on the screen, as PNG. */
  private async savePicture(): Promise<string> {
    const { blob, title } = await this.reserve(async ({ navigator, title }) => {
      const view = navigator.view(this.canvas.width, this.canvas.height);
      await this.sort(view);
      this.renderer.render(view, this.picture(this.settings.mode, navigator.pinned));
      // Asked for before anything else runs: the browser clears the canvas when it has shown it.
      return { title, blob: await new Promise<Blob | null>((resolve) => this.canvas.toBlob(resolve)) };
    });
    if (!blob) throw new Error('The browser cannot make a PNG file of this size.');
    save(blob, `${title}.png`);
    return `Saved, ${this.canvas.width} × ${this.canvas.height} pixels.`;
  }

  private fail(title: string, message: string): void {
    showError(title, message, this.loaded !== undefined);
  }

  /** Reads and shows a file; `inAddress` says whether the page's address leads to it. What fails is said on the page; what was there before stays where the file could not be read. */
  async open(source: (signal: AbortSignal) => Promise<Source>, inAddress = true): Promise<void> {
    this.loading.abort();
    const { signal } = (this.loading = new AbortController());
    let name = 'the model';
    try {
      const { name: found, size, stream } = await source(signal);
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
      this.again = { open: () => this.open(source, inAddress), inAddress };
    } catch (error) {
      if (signal.aborted) return; // another file is on its way
      this.fail(error instanceof FormatError ? `${name} cannot be read` : `${name} cannot be shown`, (error as Error).message);
    }
  }

  /** The device is gone, and all on it. What is deleted now, before another one comes, needs no device. */
  private lose(): void {
    this.playing.abort();
    if (this.loaded) this.begin = this.fragment();
    this.unload();
    this.renderer.forget();
    this.fail('The graphics device was lost', 'Often its memory ran out. The model comes back with the device; where that takes long, reload the page. A smaller model may help.');
  }

  /** The device is back, but the file's bytes were let go of: reads it again, and shows what was seen. */
  private async restore(): Promise<void> {
    if (!this.again) return showWelcome();
    await this.again.open();
    this.begin = undefined; // also where it could not be read
  }

  private unload(): void {
    this.loaded?.navigator.dispose();
    this.loaded?.sorter?.dispose();
    this.loaded = undefined;
    this.renderer.clearScene();
    document.body.classList.remove('loaded');
  }

  private show(name: string, scene: Scene, bytes: number): void {
    this.unload(); // first, so that both need not fit into memory
    const centers = sceneCenters(scene), sample = new CenterSample(scene.count);
    sample.add(scene.geometry);
    this.renderer.setScene(scene);
    document.body.classList.add('loaded');
    const navigator = new Navigator(scene, this.canvas, () => this.redraw());
    navigator.setMovement(this.settings.movement);
    const apply = (order: Uint32Array, count: number) => {
      this.redraw();
      return this.renderer.setOrder(order, count);
    };
    const sorter = scene.count ? new SortClient(centers, apply, (message) => this.fail('Sorting failed', message)) : undefined;
    const title = scene.name ?? name;
    this.loaded = { name, title, scene, sample, navigator, sorter };
    this.sortedFor = '';
    this.panel.setScene(title, scene);
    this.panel.setInfo(sceneInfo(scene, bytes, this.renderer.bytes));
    this.benchmarkPanel.clear();
    if (this.begin === undefined) this.panel.show(this.settings);
    else this.apply(this.begin);
    this.begin = undefined;
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

  private picture(mode: Mode, testView: number | undefined): Picture {
    const { scene } = this.loaded!, { photometric } = scene, { settings } = this;
    const exposure = settings.photometric && photometric ? (testView === undefined ? photometric.neutral : photometric.testViews[testView]) : undefined;
    const ownColors = mode === 'full' || mode === 'base';
    return {
      mode, background: ownColors ? settings.background ?? scene.background : [0, 0, 0], exposure: ownColors ? exposure : undefined,
      splats: { size: settings.points ? 0 : settings.splatSize, near: settings.near },
    };
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
    this.address.touch();
    try {
      this.renderer.render(view, this.picture(this.settings.mode, navigator.pinned));
      this.meter.frame(performance.now(), sorter?.milliseconds ?? 0, this.renderer.drawn);
    } catch (error) {
      this.unload();
      this.fail('This model cannot be drawn', (error as Error).message);
    }
  }

  /** The order that `work` sorts for stays: nothing else is drawn meanwhile. */
  private async reserve<T>(work: (loaded: Loaded) => Promise<T>): Promise<T> {
    if (this.isReserved) throw new Error('another one is running');
    const { model } = this;
    this.isReserved = true;
    try {
      return await work(model);
    } finally {
      this.isReserved = false;
      this.redraw();
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
