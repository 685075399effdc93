// SPDX-License-Identifier: Apache-2.0
// The model that is compared with the first one. It is fetched when it is first shown, because both then are in memory.

import type { View } from '../camera/view';
import { messageOf } from '../format/cursor';
import { fetchSource, readParts } from '../format/load';
import type { Scene } from '../format/ngsplat';
import { SceneReader } from '../format/reader';
import type { Renderer } from '../render/renderer';
import type { Picture } from '../render/scene_renderer';
import { SortClient } from '../sort/sort_client';
import { megabytes } from '../ui/notice';

interface Loaded {
  scene: Scene;
  sorter?: SortClient;
}

export class SecondModel {
  private readonly transfer = new AbortController();
  private loaded: Loaded | undefined;
  private sortedFor = '';
  /** Why it cannot be drawn; undefined where it can. */
  obstacle: string | undefined = 'It is not loaded yet.';

  /** `renderer` has no scene yet. `changed` is called when there is something to draw, or to say. */
  constructor(
    private readonly renderer: Renderer,
    private readonly file: string,
    numViews: number,
    private readonly changed: () => void,
  ) {
    this.load(numViews).catch((error: Error) => {
      if (!this.transfer.signal.aborted) this.fail(error);
    });
  }

  private async load(numViews: number): Promise<void> {
    const { signal } = this.transfer;
    const source = await fetchSource(this.file, signal);
    const reader = new SceneReader(
      {
        begin: (scene) => this.begin(scene, numViews),
        rows: (plane, row, texels) => {
          this.renderer.addRows(plane, row, texels);
          if (plane.block < 0) this.loaded!.sorter?.add(texels);
        },
      },
      source.size,
    );
    await readParts(source, (part) => {
      signal.throwIfAborted();
      reader.push(part);
      const size = reader.end ?? source.size;
      this.obstacle = `Loading ${this.file}: ${megabytes(reader.bytes)}${size ? ` of ${megabytes(size)}` : ''}`;
      this.changed();
    });
    signal.throwIfAborted();
    reader.finish();
    this.renderer.completeScene();
    this.obstacle = undefined;
    this.changed();
  }

  private begin(scene: Scene, numViews: number): void {
    if (scene.testCameras.length !== numViews)
      throw new Error(`it has ${scene.testCameras.length} test views, the first model ${numViews}`);
    this.renderer.beginScene(scene);
    const apply = (order: Uint32Array, count: number) => {
      this.changed();
      return this.renderer.setOrder(order, count);
    };
    const sorter = scene.count
      ? new SortClient(scene.count, apply, (message) => this.fail(new Error(message)))
      : undefined;
    this.loaded = { scene, sorter };
  }

  private fail(error: Error): void {
    this.dispose();
    this.obstacle = `${this.file} cannot be shown: ${messageOf(error)}`;
    this.changed();
  }

  /** Bytes on the GPU. */
  get bytes(): number {
    return this.loaded ? this.renderer.bytes : 0;
  }

  /** Draws it where there is no obstacle. `picture` says how. */
  draw(view: View, picture: (scene: Scene) => Picture): void {
    const { scene, sorter } = this.loaded!;
    const wanted = picture(scene);
    const key = JSON.stringify([view, wanted.splats.size]);
    if (key !== this.sortedFor) void sorter?.sort(view, wanted.splats.size);
    this.sortedFor = key;
    try {
      this.renderer.render(view, wanted);
    } catch (error) {
      this.fail(error as Error);
    }
  }

  dispose(): void {
    this.transfer.abort();
    this.loaded?.sorter?.dispose();
    this.loaded = undefined;
    this.renderer.clearScene();
  }
}
