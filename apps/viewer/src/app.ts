// SPDX-License-Identifier: Apache-2.0
// The page: one renderer, at most one model, and what the user asked to see of it.

import { AddressBar, formatAddress, parseAddress, type Address } from './address';
import { ModelSample } from './camera/extent';
import { axisOf, Navigator } from './camera/navigator';
import type { View } from './camera/view';
import { Comparison } from './compare/comparison';
import type { Site } from './compare/site';
import { Films } from './films';
import type { Scene } from './format/ngsplat';
import type { Plane } from './format/reader';
import type { Vector } from './format/vector';
import { Levels, type Level } from './levels/levels';
import { ModelLoader, type Stage } from './loader';
import { PAGE } from './page';
import { Pictures, type Subject } from './pictures';
import type { Mode } from './render/prepass';
import { Renderer } from './render/renderer';
import type { Picture, SceneRenderer } from './render/scene_renderer';
import { Screen } from './screen';
import { DEFAULTS, type Settings } from './settings';
import { SortClient } from './sort/sort_client';
import { BenchmarkPanel } from './ui/benchmark_panel';
import { toggleFullscreen } from './ui/fullscreen';
import { onKeys } from './ui/keys';
import { Meter } from './ui/meter';
import { hideNotice, showError } from './ui/notice';
import { Panel, sceneInfo } from './ui/panel';
import { focusPicture, showSpeed } from './ui/picture';
import { Headset } from './xr/headset';

/** Milliseconds between two pictures of a model that is on its way. */
const REFRESH = 200;

interface Loaded extends Subject {
  sample: ModelSample;
  /** Whether it is the model that the page was made for. */
  isOwn: boolean;
  sorter?: SortClient;
}

/** Equal where the order is. */
const orderKey = ({ position, right, forward, fx, fy, cx, cy, width, height }: View, size: number): string =>
  JSON.stringify([position, right, forward, fx, fy, cx, cy, width, height, size]);

export class App implements Stage {
  private readonly screen: Screen;
  private readonly panel: Panel;
  /** Saves pictures and times frames. */
  readonly pictures = new Pictures({
    model: () => this.model,
    renderer: () => this.renderer,
    signal: () => this.loader.signal,
    sort: (view) => this.sort(view),
    picture: (mode, testView) => this.picture(mode, testView),
    drawView: (view, testView) => this.drawView(view, testView),
    redraw: () => this.redraw(),
  });
  private readonly benchmarkPanel = new BenchmarkPanel((frames, progress) => this.pictures.benchmark(frames, progress));
  private readonly films = new Films({
    model: () => this.model,
    canvas: () => this.renderer.canvas,
    show: (view) => this.move((navigator) => navigator.showExactly(view)),
    draw: () => this.draw(),
  });
  private readonly meter = new Meter();
  private readonly comparison = new Comparison(() => this.redraw());
  private readonly levels = new Levels(
    (file) => this.loader.showLevel(file),
    (detail) => this.change({ detail }),
  );
  private readonly headset = new Headset({
    webGl: () => this.useWebGl(),
    sort: (view) => void this.sort(view),
    ended: () => this.redraw(),
    fail: (title, message) => this.fail(title, message),
    model: () => {
      if (!this.loaded || this.awaitsOrder) return undefined;
      const { navigator } = this.loaded;
      return {
        picture: this.picture(this.settings.mode, undefined),
        position: navigator.current().position,
        target: navigator.target,
        up: navigator.up,
      };
    },
  });
  private loaded: Loaded | undefined;
  /** What opens files and shows them here. */
  readonly loader = new ModelLoader(this);
  private settings: Settings = { ...DEFAULTS };
  private readonly address = new AddressBar(() => this.fragment());
  /** The fragment that the next model is shown with. */
  private wanted: string | undefined = location.hash;
  private sortedFor = '';
  private scheduled = false;
  /** A newer state of the model is there, but not all of it, or not its order: the picture before stays. */
  private awaitsOrder = false;
  private refreshing: ReturnType<typeof setTimeout> | undefined;

  /** Draws by WebGPU where there is a device, as long as that can. Throws RenderError where nothing can draw. */
  constructor(device?: GPUDevice) {
    this.screen = new Screen(device, {
      resized: () => this.draw(), // at once: setting the size has cleared the picture
      failed: (message) => this.leaveWebGpu(message),
      counted: () => this.meter.show(this.renderer.drawn),
    });
    const savePicture = () => this.pictures.save();
    this.panel = new Panel({
      change: (settings) => this.change(settings),
      camera: (index) => this.move((navigator) => (index === undefined ? navigator.unpin() : navigator.pin(index))),
      frame: this.frame,
      reset: this.reset,
      copyLink: () => this.copyLink(),
      savePicture,
    });
    this.settings.panel = parseAddress(location.hash).settings.panel; // at once; the rest waits for the model
    this.panel.show(this.settings);
    const saved = () =>
      void savePicture().catch((error: Error) => this.fail('The picture cannot be saved', error.message));
    const { canvas } = this.screen;
    const stop = () => this.films.stop();
    onKeys(
      canvas,
      { f: this.frame, r: this.reset, x: toggleFullscreen, p: saved, k: () => this.loaded && this.films.addKeyframe() },
      stop,
    );
    for (const event of ['pointerdown', 'wheel', 'keydown']) canvas.addEventListener(event, stop);
    canvas.addEventListener(
      'dblclick',
      ({ offsetX, offsetY }) => void this.turnTo(offsetX / canvas.clientWidth, offsetY / canvas.clientHeight),
    );
    addEventListener('hashchange', (event) => {
      const { hash } = new URL(event.newURL); // the address may have been brought up to date since
      if (this.loaded) this.apply(hash);
      else this.wanted = hash;
    });
    canvas.addEventListener('webglcontextlost', () => this.lose());
    canvas.addEventListener('webglcontextrestored', () => void this.loader.restore());
  }

  private get renderer(): SceneRenderer {
    return this.screen.renderer;
  }

  /** Draws for a headset. */
  private useWebGl(): Renderer {
    if (!(this.renderer instanceof Renderer)) this.leaveWebGpu('headsets are drawn for by it');
    if (!(this.renderer instanceof Renderer)) throw new Error('This browser does not offer WebGL2.');
    return this.renderer;
  }

  /** From here on WebGL2 draws; a scene is read again. `message` says why. */
  private leaveWebGpu(message: string): void {
    console.info(`WebGL2 draws from here on: ${message}`);
    if (this.loaded) this.wanted = this.fragment();
    this.loader.stop();
    this.unload();
    try {
      this.screen.useWebGl();
    } catch (error) {
      return this.fail('This model cannot be drawn', (error as Error).message);
    }
    void this.loader.restore();
  }

  private change(settings: Partial<Settings>): void {
    const { movement, up } = this.settings;
    Object.assign(this.settings, settings);
    if (this.settings.movement !== movement) this.loaded?.navigator.setMovement(this.settings.movement);
    if (this.settings.up !== up) this.loaded?.navigator.setUp(this.up(this.loaded.scene));
    this.panel.show(this.settings);
    if ('detail' in settings) this.levels.choose(this.settings.detail);
    this.redraw();
  }

  private move(how: (navigator: Navigator, loaded: Loaded) => void): void {
    if (this.loaded) how(this.loaded.navigator, this.loaded);
    this.redraw();
  }

  private readonly frame = () => this.move((navigator) => navigator.frame());
  private readonly reset = () => this.move((navigator) => navigator.reset());

  /** Turns to what is seen at a place of the picture, given as shares of its width and height. */
  private async turnTo(x: number, y: number): Promise<void> {
    const { loaded } = this;
    if (!loaded || this.isReserved) return;
    const point = await this.pictures.pointAt(x, y);
    if (point && loaded === this.loaded) this.move((navigator) => navigator.turnTo(point));
  }

  /** The direction that is up in a scene. */
  private up(scene: Scene): Vector {
    return this.settings.up ? axisOf(this.settings.up) : scene.up;
  }

  /** What the address says of the picture. */
  private state(): Address {
    const {
      settings,
      comparison: { compared },
    } = this;
    const navigator = this.loaded?.navigator;
    if (!navigator || navigator.isFirst) return { settings, compared };
    return {
      settings,
      compared,
      camera:
        navigator.pinned === undefined
          ? { from: navigator.current().position, to: navigator.target, fov: navigator.fov }
          : { view: navigator.pinned },
    };
  }

  private fragment(): string {
    // until then it is not known which camera a model has
    if (!this.loaded) return (this.wanted ?? location.hash).replace(/^#/, '');
    return formatAddress(this.state(), this.loaded.scene.distance);
  }

  /** Shows what a fragment says, as far as this model has it. */
  private apply(fragment: string): void {
    this.show(parseAddress(fragment));
  }

  private show({ settings, camera, compared }: Address): void {
    this.change(settings);
    this.comparison.compared = compared;
    this.move((navigator, { scene }) => {
      if (camera && 'from' in camera) navigator.look(camera.from, camera.to, camera.fov);
      else if (camera && camera.view < scene.testCameras.length) navigator.pin(camera.view);
      else navigator.reset();
    });
  }

  /** The model that is shown, or of which a part is. */
  get shown(): { scene: Scene; isComplete: boolean } | undefined {
    return this.loaded;
  }

  /** The level that the user wants; undefined leaves it to the page. */
  get wantedDetail(): number | undefined {
    return this.wanted === undefined ? this.settings.detail : parseAddress(this.wanted).settings.detail;
  }

  get isReserved(): boolean {
    return this.pictures.isReserved || this.headset.isOn;
  }

  private get model(): Loaded {
    if (!this.loaded) throw new Error('There is no model yet.');
    return this.loaded;
  }

  private async copyLink(): Promise<string> {
    this.address.write();
    const file = this.loader.isInAddress
      ? ''
      : ' It cannot hold the file that you opened: put that on a web server, and its address behind ?model=.';
    try {
      await navigator.clipboard.writeText(location.href);
    } catch {
      return `The browser does not allow copying; the link is the address of this page.${file}`;
    }
    return `Copied.${file}`;
  }

  fail(title: string, message: string): void {
    showError(title, message, this.loaded !== undefined);
  }

  /** The device is gone, and all on it. What is deleted now, before another one comes, needs no device. */
  private lose(): void {
    if (this.loaded) this.wanted = this.fragment();
    const smaller = this.levels.smallerAfterLoss();
    this.loader.stop(smaller);
    this.unload();
    this.renderer.forget();
    const help = smaller
      ? 'A coarser level of the model comes back with the device'
      : 'The model comes back with the device';
    const advice = smaller ? '' : ' A smaller model may help.';
    this.fail(
      'The graphics device was lost',
      `Often its memory ran out. ${help}; where that takes long, reload the page.${advice}`,
    );
  }

  /** Unloads a model that never became complete. */
  dropPart(): void {
    if (this.loaded && !this.loaded.isComplete) this.unload();
  }

  private unload(keep?: Navigator): void {
    if (!keep) this.loaded?.navigator.dispose();
    this.loaded?.sorter?.dispose();
    this.loaded = undefined;
    this.renderer.clearScene();
    if (keep) return;
    this.films.stop();
    this.comparison.setScene(undefined);
    this.levels.clear();
    document.body.classList.remove('loaded');
  }

  /**
   * Shows a scene whose texels follow, with `keepCamera` from where the camera is. `isOwn`: the page was made for it.
   */
  beginScene(name: string, scene: Scene, keepCamera: boolean, isOwn: boolean): void {
    const keep = keepCamera ? this.loaded?.navigator : undefined;
    this.unload(keep); // first, so that both need not fit into memory
    let sorter: SortClient | undefined;
    try {
      this.screen.beginScene(scene);
      if (scene.count && !this.renderer.sortsItself) sorter = this.sorterOf(scene);
    } catch (error) {
      keep?.dispose();
      this.unload();
      throw error;
    }
    document.body.classList.add('loaded');
    if (keep) this.comparison.replaceScene(scene);
    else this.comparison.setScene(scene);
    const sample = new ModelSample(scene.count, scene.testCameras);
    const start = isOwn ? PAGE.start : undefined;
    if (!keep && this.wanted === undefined) this.settings.up = undefined; // of the file before
    const navigator =
      keep ??
      new Navigator(
        scene,
        sample,
        this.screen.canvas,
        { changed: () => this.redraw(), faster: showSpeed },
        start?.camera,
      );
    if (keep) keep.setScene(scene, sample);
    else {
      navigator.setMovement(this.settings.movement);
      if (this.settings.up) navigator.setUp(this.up(scene));
    }
    this.awaitsOrder = keep !== undefined && scene.count > 0;
    this.loaded = { name, title: name, isComplete: false, isOwn, scene, sample, navigator, sorter };
    this.sortedFor = '';
    this.benchmarkPanel.clear();
    if (keep && this.panel.numViews === scene.testCameras.length) return;
    this.panel.setScene(isOwn ? (PAGE.title ?? name) : name, scene);
    this.panel.setInfo([]);
    const isBare = this.wanted === '' || this.wanted === '#';
    if (isBare && start) this.show({ ...start, camera: undefined });
    else if (this.wanted !== undefined) this.apply(this.wanted);
    else this.panel.show(this.settings);
    this.wanted = undefined;
    focusPicture(this.screen.canvas);
  }

  private sorterOf({ count }: Scene): SortClient {
    const apply = (order: Uint32Array, drawn: number) => {
      if (this.loaded?.isComplete) this.awaitsOrder = false;
      this.redraw();
      return this.renderer.setOrder(order, drawn);
    };
    return new SortClient(count, apply, (message) => this.fail('Sorting failed', message));
  }

  addRows(plane: Plane, row: number, texels: Uint32Array): void {
    const { loaded } = this;
    if (!loaded) return; // it could not be drawn, which was said
    this.renderer.addRows(plane, row, texels);
    if (plane.block >= 0) return;
    loaded.sample.add(texels);
    loaded.sorter?.add(texels);
    this.refreshing ??= setTimeout(() => {
      this.refreshing = undefined;
      if (this.loaded?.scene.testCameras.length === 0) this.loaded.navigator.learn();
      this.sortedFor = '';
      this.redraw();
    }, REFRESH);
  }

  /** The scene has all its texels, and what the end of its file says. */
  complete(bytes: number): void {
    const { loaded } = this;
    if (!loaded) return; // it could not be drawn, which was said
    const { name, scene, isOwn, navigator } = loaded;
    loaded.isComplete = true;
    navigator.learn();
    if (this.renderer.sortsItself) this.awaitsOrder = false;
    loaded.title = (isOwn ? PAGE.title : undefined) ?? scene.name ?? name;
    this.renderer.completeScene();
    this.sortedFor = '';
    this.panel.setEnd(loaded.title, scene);
    this.panel.show(this.settings);
    this.panel.setInfo(sceneInfo(scene, bytes, this.renderer.bytes));
    hideNotice(); // before drawing, which may have something to say
    this.draw();
  }

  private redraw(): void {
    if (this.scheduled) return;
    this.scheduled = true;
    const asked = performance.now();
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.draw();
      if (this.loaded?.isComplete && !this.isReserved) this.levels.frame(performance.now() - asked);
    });
  }

  private picture(mode: Mode, testView: number | undefined, scene = this.loaded!.scene): Picture {
    const { photometric } = scene;
    const { settings } = this;
    const exposure =
      settings.photometric && photometric
        ? testView === undefined
          ? photometric.neutral
          : photometric.testViews[testView]
        : undefined;
    const ownColors = mode === 'full' || mode === 'base';
    return {
      mode,
      background: ownColors ? (settings.background ?? scene.background) : [0, 0, 0],
      exposure: ownColors ? exposure : undefined,
      splats: { size: settings.points ? 0 : settings.splatSize, near: settings.near },
    };
  }

  /** The factor of all scales, which decides about what a view shows. */
  private get size(): number {
    return this.settings.points ? 0 : this.settings.splatSize;
  }

  private sort(view: View): Promise<void> {
    this.sortedFor = orderKey(view, this.size);
    return this.loaded!.sorter?.sort(view, this.size) ?? Promise.resolve();
  }

  /** What the canvas is to show. */
  private drawView(view: View, pinned: number | undefined): void {
    if (this.comparison.isOn && this.renderer instanceof Renderer)
      this.comparison.draw(this.renderer, view, pinned, (mode, scene) => this.picture(mode, pinned, scene));
    else this.renderer.render(view, this.picture(this.settings.mode, pinned));
  }

  private draw(): void {
    if (!this.loaded || this.isReserved) return;
    if (this.comparison.isOn && !(this.renderer instanceof Renderer))
      return this.leaveWebGpu('comparisons are drawn by it');
    const { navigator, sorter } = this.loaded;
    if (this.awaitsOrder && !this.loaded.isComplete) return;
    const { canvas } = this.renderer;
    const view = navigator.view(canvas.width, canvas.height);
    if (orderKey(view, this.size) !== this.sortedFor) void this.sort(view);
    if (this.awaitsOrder) return;
    this.panel.setCamera(navigator.pinned);
    this.address.touch();
    try {
      this.drawView(view, navigator.pinned);
      this.meter.frame(
        performance.now(),
        sorter ? sorter.milliseconds : this.renderer.sortsItself ? 'on the GPU' : 0,
        this.renderer.drawn,
      );
    } catch (error) {
      this.loader.stop(); // what is still on its way cannot be drawn, either
      this.unload();
      this.fail('This model cannot be drawn', (error as Error).message);
    }
  }

  /** What lies beside the model, of which `file` is shown. */
  setSite(site: Site, file = ''): void {
    this.comparison.setSite(site);
    if (site.levels) this.levels.set(site.levels, file, this.settings.detail);
  }

  /** The file of the level to begin with. */
  firstLevel(levels: Level[], tooLarge?: number): string {
    if (tooLarge !== undefined) this.levels.refuse(tooLarge);
    return this.levels.begin(levels, this.wantedDetail);
  }
}
