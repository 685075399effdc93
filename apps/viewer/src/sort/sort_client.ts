// SPDX-License-Identifier: Apache-2.0
// The worker as the page sees it: at most one sort runs, and of the cameras that come meanwhile only the last is sorted for.

import { halfToFloat } from '../format/half';
import type { Scene } from '../format/ngsplat';
import type { Vector } from '../format/vector';
import type { SortRequest, SortResult } from './worker';

/** x, y, z of every Gaussian, from its packed geometry. */
export function sceneCenters(scene: Scene): Float32Array<ArrayBuffer> {
  const values = new Float32Array(1 << 16); // of every half-precision number
  for (let bits = 0; bits < values.length; ++bits) values[bits] = halfToFloat(bits);
  const centers = new Float32Array(3 * scene.count);
  for (let i = 0; i < scene.count; ++i) {
    const xy = scene.geometry[4 * i + 1];
    centers[3 * i] = values[xy & 0xffff];
    centers[3 * i + 1] = values[xy >>> 16];
    centers[3 * i + 2] = values[scene.geometry[4 * i + 2] & 0xffff];
  }
  return centers;
}

type Pose = { position: Vector; forward: Vector };

export class SortClient {
  private readonly worker = new Worker(new URL('./worker.ts', import.meta.url), { type: 'module' });
  private spare: Uint32Array<ArrayBuffer> | undefined;
  private wanted: Pose | undefined;
  private waiting: (() => void)[] = [];
  milliseconds = 0;

  /** `centers` as of sceneCenters, which go to the worker. `apply` takes a finished order and its count, and returns an array of the same length that is no longer needed. */
  constructor(centers: Float32Array<ArrayBuffer>, apply: (order: Uint32Array, count: number) => Uint32Array, onError: (message: string) => void) {
    this.spare = new Uint32Array(centers.length / 3);
    this.worker.onmessage = ({ data }: MessageEvent<SortResult>) => {
      this.spare = apply(data.order, data.count) as Uint32Array<ArrayBuffer>;
      this.milliseconds = data.milliseconds;
      if (this.wanted) this.start();
      else this.settle();
    };
    this.worker.onerror = (event) => onError(`Sorting failed: ${event.message}`);
    this.worker.postMessage(centers, [centers.buffer]);
  }

  /** Resolves when the order of the last camera asked for is applied, or never will be. */
  sort(pose: Pose): Promise<void> {
    this.wanted = pose;
    if (this.spare) this.start();
    return new Promise((resolve) => this.waiting.push(resolve));
  }

  private settle(): void {
    this.waiting.splice(0).forEach((resolve) => resolve());
  }

  private start(): void {
    const order = this.spare!, { position, forward } = this.wanted!;
    this.spare = this.wanted = undefined;
    const request: SortRequest = { position, forward, order };
    this.worker.postMessage(request, [order.buffer]);
  }

  dispose(): void {
    this.worker.onmessage = null; // a result may be on its way
    this.worker.terminate();
    this.settle();
  }
}
