// SPDX-License-Identifier: Apache-2.0
// The worker as the page sees it: at most one sort runs, and of the cameras that come meanwhile only the last is sorted for.

import type { View } from '../camera/view';
import type { SortRequest, SortResult } from './worker';

export class SortClient {
  private readonly worker = new Worker(new URL('./worker.ts', import.meta.url), { type: 'module' });
  private spare: Uint32Array<ArrayBuffer> | undefined;
  private wanted: Omit<SortRequest, 'order'> | undefined;
  private waiting: (() => void)[] = [];
  /** The time of the last sort; undefined before the first has ended. */
  milliseconds: number | undefined;

  /** For `count` Gaussians. `apply` takes a finished order and its count, and returns an array of the same length that is no longer needed. */
  constructor(count: number, apply: (order: Uint32Array, count: number) => Uint32Array, onError: (message: string) => void) {
    this.spare = new Uint32Array(count);
    this.worker.onmessage = ({ data }: MessageEvent<SortResult>) => {
      this.spare = apply(data.order, data.count) as Uint32Array<ArrayBuffer>;
      this.milliseconds = data.milliseconds;
      if (this.wanted) this.start();
      else this.settle();
    };
    this.worker.onerror = (event) => onError(`Sorting failed: ${event.message}`);
    this.worker.postMessage(count);
  }

  /** The next Gaussians' packed geometry, which the next sort takes too. */
  add(texels: Uint32Array): void {
    const copy = texels.slice();
    this.worker.postMessage(copy, [copy.buffer]);
  }

  /** With scales `size` times as large. Resolves when the order of the last view asked for is applied, or never will be. */
  sort(view: View, size = 1): Promise<void> {
    this.wanted = { view, size };
    if (this.spare) this.start();
    return new Promise((resolve) => this.waiting.push(resolve));
  }

  private settle(): void {
    this.waiting.splice(0).forEach((resolve) => resolve());
  }

  private start(): void {
    const order = this.spare!, request: SortRequest = { ...this.wanted!, order };
    this.spare = this.wanted = undefined;
    this.worker.postMessage(request, [order.buffer]);
  }

  dispose(): void {
    this.worker.onmessage = null; // a result may be on its way
    this.worker.terminate();
    this.settle();
  }
}
