// SPDX-License-Identifier: Apache-2.0
// The worker as the page sees it: at most one sort runs, and of the cameras that come meanwhile only the last is sorted
// for.

import type { View } from '../camera/view';
import type { SortRequest, SortResult } from './worker';

/**
 * Workers that nobody needs at present. They are used again: the server of the page may have ended since, and with it
 * their program.
 */
const idle: Worker[] = [];
let numClients = 0;

export class SortClient {
  private readonly client = ++numClients;
  private readonly worker: Worker;
  /** It has answered, so its program is there. */
  private isReady: boolean;
  private spare: Uint32Array<ArrayBuffer> | undefined;
  private wanted: Pick<SortRequest, 'view' | 'size'> | undefined;
  private waiting: (() => void)[] = [];
  private hasFailed = false;
  /** The time of the last sort; undefined before the first has ended. */
  milliseconds: number | undefined;

  /**
   * For `count` Gaussians. `apply` takes a finished order and its count, and returns an array of the same length that
   * is no longer needed.
   */
  constructor(
    count: number,
    apply: (order: Uint32Array, count: number) => Uint32Array,
    onError: (message: string) => void,
  ) {
    this.spare = new Uint32Array(count); // first: there may be no memory for it
    const known = idle.pop();
    this.isReady = known !== undefined;
    this.worker = known ?? new Worker(new URL('./worker.ts', import.meta.url), { type: 'module' });
    this.worker.onmessage = ({ data }: MessageEvent<SortResult>) => {
      if (data.client !== this.client) return; // the last sort of the one before
      this.isReady = true;
      this.spare = apply(data.order, data.count) as Uint32Array<ArrayBuffer>;
      this.milliseconds = data.milliseconds;
      if (this.wanted) this.start();
      else this.settle();
    };
    this.worker.onerror = (event) => {
      this.hasFailed = true;
      this.isReady = false;
      onError(event.message || 'Its program cannot be loaded.');
      this.settle();
    };
    this.worker.postMessage(count);
  }

  /** The next Gaussians' packed geometry, which the next sort takes too. */
  add(texels: Uint32Array): void {
    const copy = texels.slice();
    this.worker.postMessage(copy, [copy.buffer]);
  }

  /**
   * With scales `size` times as large. Resolves when the order of the last view asked for is applied, or never will be.
   */
  sort(view: View, size = 1): Promise<void> {
    this.wanted = { view, size };
    if (this.hasFailed) return Promise.resolve();
    if (this.spare) this.start();
    return new Promise((resolve) => this.waiting.push(resolve));
  }

  private settle(): void {
    this.waiting.splice(0).forEach((resolve) => resolve());
  }

  private start(): void {
    const order = this.spare!;
    const request: SortRequest = { ...this.wanted!, client: this.client, order };
    this.spare = this.wanted = undefined;
    this.worker.postMessage(request, [order.buffer]);
  }

  dispose(): void {
    this.worker.onmessage = this.worker.onerror = null; // a result may be on its way
    if (this.isReady) {
      this.worker.postMessage(0); // lets go of the geometry
      idle.push(this.worker);
    } else {
      this.worker.terminate();
    }
    this.settle();
  }
}
