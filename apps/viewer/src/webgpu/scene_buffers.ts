// SPDX-License-Identifier: Apache-2.0
// The data of one file in buffers on the device.

import { TEXTURE_WIDTH, type Scene } from '../format/ngsplat';
import { planeBytes, planesOf, type Plane } from '../format/reader';
import { RenderError } from '../render/scene_renderer';
import { GROUP, storage } from './kernel';

/** Most workgroups of a dispatch, which every device has. */
const MOST_GROUPS = 65535;

export class SceneBuffers {
  readonly geometry: GPUBuffer;
  /** Texels of four and of two words, layer behind layer. */
  readonly quads: GPUBuffer;
  readonly pairs: GPUBuffer;
  readonly bytes: number;

  /** Throws RenderError where the device cannot hold the scene. */
  constructor(
    private readonly device: GPUDevice,
    readonly scene: Scene,
  ) {
    const { limits } = device;
    const most = Math.min(limits.maxBufferSize, limits.maxStorageBufferBindingSize);
    const planes = planesOf(scene);
    const sizes = [
      planes.filter(({ block }) => block < 0),
      ...[4, 2].map((words) => planes.filter((plane) => plane.block >= 0 && plane.words === words)),
    ].map((some) => some.reduce((sum, plane) => sum + planeBytes(plane), 0));
    const largest = Math.max(...sizes);
    if (largest > most)
      throw new RenderError(`This device holds ${most} bytes in a buffer; the file needs ${largest}.`);
    if (scene.count > MOST_GROUPS * GROUP)
      throw new RenderError(`This device draws at most ${MOST_GROUPS * GROUP} Gaussians; the file has ${scene.count}.`);
    [this.geometry, this.quads, this.pairs] = sizes.map((bytes) => storage(device, bytes));
    this.bytes = sizes.reduce((sum, bytes) => sum + bytes, 4 * scene.weights.length);
  }

  /** Copies rows of a texture of the file. */
  write({ block, layer, words }: Plane, row: number, texels: Uint32Array): void {
    const buffer = block < 0 ? this.geometry : words === 4 ? this.quads : this.pairs;
    const rows = block < 0 ? 0 : this.scene.payloadHeight;
    this.device.queue.writeBuffer(
      buffer,
      4 * words * TEXTURE_WIDTH * (layer * rows + row),
      texels as Uint32Array<ArrayBuffer>,
    );
  }

  dispose(): void {
    for (const buffer of [this.geometry, this.quads, this.pairs]) buffer.destroy();
  }
}
