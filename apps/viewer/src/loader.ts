// SPDX-License-Identifier: Apache-2.0
// From a file to a model that is shown: opening, levels that suit the device, newer states, and all of it again after
// the device was lost.

import { fetchSite, FIRST_MODEL, SITE_FILE, type Site } from './compare/site';
import { FormatError, messageOf } from './format/cursor';
import { fetchSource, type Source } from './format/load';
import type { Scene } from './format/ngsplat';
import { readModel, type ModelRead, type ReadOptions } from './format/read_model';
import { planeBytes, planesOf, type Plane, type SceneSink } from './format/reader';
import type { Level } from './levels/levels';
import { memoryHere, memoryOf } from './levels/memory';
import { RenderError } from './render/scene_renderer';
import { showLoading, showRemark, showWelcome } from './ui/notice';

/** Where a model is shown. */
export interface Stage {
  /** The model that is shown, or of which a part is. */
  readonly shown: { scene: Scene; isComplete: boolean } | undefined;
  /** Something needs the model as it is. */
  readonly isReserved: boolean;
  /** The level that the user wants; undefined leaves it to the page. */
  readonly wantedDetail: number | undefined;
  /**
   * Shows a scene whose texels follow, with `keepCamera` from where the camera is. `isOwn`: the page was made for it.
   * Throws RenderError where the device cannot hold it.
   */
  beginScene(name: string, scene: Scene, keepCamera: boolean, isOwn: boolean): void;
  addRows(plane: Plane, row: number, texels: Uint32Array): void;
  /** The scene has all its texels, and what the end of its file, of so many bytes, says. */
  complete(bytes: number): void;
  /** Unloads a model that never became complete. */
  dropPart(): void;
  /** What lies beside the model, of which `file` is shown. */
  setSite(site: Site, file: string): void;
  /** The file of the level to begin with. */
  firstLevel(levels: Level[], tooLarge?: number): string;
  fail(title: string, message: string): void;
}

/** Begins to read a file. */
type Open = (signal: AbortSignal) => Promise<Source>;

/** Where a file is: beside the page, where its address leads, or elsewhere. */
type Place = 'beside' | 'address' | 'elsewhere';

/** Something else needs the model as it is. */
class Busy extends Error {}

/** A coarser level of the model suits better, if there is one. */
class Unsuitable extends Error {}

export class ModelLoader {
  private loading = new AbortController();
  /** Opens the model again that is shown, and whether its address does so elsewhere. */
  private again: { open: () => Promise<void>; inAddress: boolean } | undefined;
  /** Opens the file again that the user wants to see and that is not shown yet. */
  private coming: (() => Promise<void>) | undefined;

  constructor(private readonly stage: Stage) {}

  /** Aborted when another model comes, or none. */
  get signal(): AbortSignal {
    return this.loading.signal;
  }

  /** Whether the page's address opens the model elsewhere. */
  get isInAddress(): boolean {
    return this.again?.inAddress ?? false;
  }

  /**
   * Nothing more comes until `restore`. Where a file is named, this one is opened when the model is to be shown again.
   */
  stop(instead?: string): void {
    this.loading.abort();
    this.loading = new AbortController();
    if (instead !== undefined) this.setAgain(() => this.openBeside(instead), true);
  }

  /**
   * The device is back, but the file's bytes were let go of: reads it again, and shows what was seen. Then comes the
   * file that was on its way to replace it, unless the user has chosen another one meanwhile.
   */
  async restore(): Promise<void> {
    if (!this.again) return showWelcome();
    const { coming } = this;
    await this.again.open();
    if (coming && coming === this.coming) await coming();
  }

  /** Opens a file beside the page, whatever the device has. */
  private openBeside(file: string): Promise<void> {
    return this.read((signal) => fetchSource(file, signal), 'beside', true);
  }

  /**
   * Reads and shows a file. Where nothing is shown, what has arrived of it is, and is taken away again if the rest is
   * not what it should be; else what was there before stays until the file is there as a whole, also where it cannot be
   * read. What fails is said on the page. Beside the page may be coarser levels, of which one is shown instead where
   * this one does not suit the device; not `anyway`.
   */
  open(source: Open, from: Place = 'address'): Promise<void> {
    const open = () => this.read(source, from, from !== 'beside', open);
    this.coming = open;
    return open();
  }

  /** The same; `again` does it again. */
  private async read(
    source: Open,
    from: Place,
    anyway: boolean,
    again: () => Promise<void> = () => this.read(source, from, anyway),
  ): Promise<void> {
    this.loading.abort();
    const { signal } = (this.loading = new AbortController());
    const isHere = () => {
      if (this.coming === again) this.coming = undefined;
    };
    this.stage.dropPart();
    // the device may be lost before the file is there
    if (!this.stage.shown) this.setAgain(again, from !== 'elsewhere');
    let name = 'the model';
    let header: Scene | undefined;
    try {
      const found = await source(signal);
      name = found.name;
      showLoading(name, 0, found.size);
      const { begin, rows } = this.sink(name, from === 'beside');
      const ifSuitable = (scene: Scene) => {
        header = scene;
        if (!anyway) this.requireSuitable(scene);
        this.setAgain(again, from !== 'elsewhere'); // what was shown is let go of now
        isHere();
        begin(scene);
      };
      const { remarks } = await this.readToEnd(
        found,
        { begin: ifSuitable, rows },
        {
          whole: this.stage.shown !== undefined,
          signal,
          progress: (...sizes) => showLoading(name, ...sizes, this.stage.shown?.isComplete === false),
        },
      );
      signal.throwIfAborted(); // where it could not be drawn, which was said
      if (remarks.length > 0) showRemark(`About ${name}`, remarks.join(' '));
      if (from === 'beside') await this.readSite(name);
    } catch (error) {
      if (signal.aborted) return; // another file is on its way
      isHere();
      this.stage.dropPart();
      if (!anyway && header && (error instanceof Unsuitable || error instanceof RenderError))
        return this.openLevel(header, error);
      this.stage.fail(
        error instanceof FormatError ? `${name} cannot be read` : `${name} cannot be shown`,
        messageOf(error),
      );
    }
  }

  /**
   * Reads all of a file. Throws RenderError, too, where an array finds no memory: the file is too large then, as one
   * that the device cannot hold.
   */
  private async readToEnd(source: Source, sink: SceneSink, options: ReadOptions): Promise<ModelRead> {
    try {
      const read = await readModel(source, sink, options);
      this.stage.complete(read.bytes);
      return read;
    } catch (error) {
      throw error instanceof RangeError ? new RenderError(messageOf(error)) : error;
    }
  }

  /** Throws Unsuitable where a coarser level is asked for, or the device has too little memory for this one. */
  private requireSuitable(scene: Scene): void {
    const bytes = planesOf(scene).reduce((sum, plane) => sum + planeBytes(plane), 0);
    if (this.stage.wantedDetail || memoryOf(bytes, scene.count) > memoryHere()) throw new Unsuitable();
  }

  /** Opens the level that suits the device; without any, all of the model, unless that was tried. */
  private async openLevel({ testCameras }: Scene, obstacle: Error): Promise<void> {
    const { signal } = this.loading;
    const { levels } = await fetchSite(testCameras.length).catch((): Partial<Site> => ({}));
    if (signal.aborted) return; // another file is on its way
    const isTooLarge = obstacle instanceof RenderError;
    if (isTooLarge && !levels?.[1])
      return this.stage.fail(
        `${FIRST_MODEL} cannot be shown`,
        `${obstacle.message} gsapp export --lod writes smaller levels.`,
      );
    return this.openBeside(
      levels ? this.stage.firstLevel(levels, isTooLarge ? levels[0].bytes : undefined) : FIRST_MODEL,
    );
  }

  /** Shows what is read, in the place of what is shown. With `keep`, the camera stays as it is. */
  private sink(name: string, isOwn: boolean, keep = false): SceneSink {
    return {
      begin: (scene) => this.stage.beginScene(name, scene, keep, isOwn),
      rows: (...part) => this.stage.addRows(...part),
    };
  }

  /**
   * Shows another state of the model, with `keep` as the camera and what is compared are. Throws Busy where something
   * else needs it as it is.
   */
  private async replace(source: Source, keep: boolean, signal: AbortSignal): Promise<void> {
    const { begin, rows } = this.sink(source.name, true, keep);
    const unlessBusy = (scene: Scene) => {
      if (this.stage.isReserved || this.stage.shown?.isComplete === false) throw new Busy();
      begin(scene);
    };
    await this.readToEnd(source, { begin: unlessBusy, rows }, { whole: true, signal, progress: () => undefined });
    // drawing it for the first time may have ended it: where WebGPU is left, it must come again
    signal.throwIfAborted();
  }

  /** The same for a page that asks again later. Returns whether there is nothing more to try. */
  async refresh(source: Source, keep: boolean): Promise<boolean> {
    const { signal } = this.loading; // of the last file: another one ends this
    try {
      await this.replace(source, keep, signal);
      return true;
    } catch (error) {
      if (signal.aborted || error instanceof Busy) return false;
      if (!this.stage.shown) this.stage.fail(`${source.name} cannot be shown`, (error as Error).message);
      return true;
    }
  }

  /**
   * Shows another level of the model where the camera is. Returns false where this should be tried again, if the model
   * is still there.
   */
  async showLevel(file: string): Promise<boolean> {
    const { signal } = this.loading;
    if (this.stage.isReserved) return false; // before anything is transferred
    try {
      await this.replace(await fetchSource(file, signal), true, signal);
    } catch (error) {
      if (signal.aborted || error instanceof Busy) return false;
      if (!this.stage.shown) this.stage.fail(`${file} cannot be shown`, (error as Error).message);
      throw error;
    }
    this.setAgain(() => this.openBeside(file), true);
    return true;
  }

  /** Whether the model that is shown came by this way. */
  isFrom(open: () => Promise<void>): boolean {
    return this.again?.open === open;
  }

  /** Says how the model that is shown can be opened again, and whether the page's address does so elsewhere. */
  setAgain(open: () => Promise<void>, inAddress: boolean): void {
    this.again = { open, inAddress };
  }

  /** Where the model shown came from beside the page: what else lies there. */
  private async readSite(file: string): Promise<void> {
    const scene = this.stage.shown?.scene;
    if (!scene?.hasSite) return;
    try {
      const site = await fetchSite(scene.testCameras.length);
      if (scene === this.stage.shown?.scene) this.stage.setSite(site, file);
    } catch (error) {
      this.stage.fail(`${SITE_FILE} cannot be read`, (error as Error).message);
    }
  }
}
