// SPDX-License-Identifier: Apache-2.0
// Sorts in a thread of its own. The first message brings the centres, every further one a camera and an array to fill.

import type { Vector } from '../format/vector';
import { DepthSorter } from './sort';

export interface SortRequest {
  position: Vector;
  forward: Vector;
  order: Uint32Array<ArrayBuffer>;
}
export interface SortResult {
  order: Uint32Array<ArrayBuffer>;
  count: number;
  milliseconds: number;
}

let sorter: DepthSorter | undefined;

self.onmessage = ({ data }: MessageEvent<Float32Array | SortRequest>) => {
  if (data instanceof Float32Array) {
    sorter = new DepthSorter(data);
    return;
  }
  const begin = performance.now();
  const count = sorter!.sort(data.position, data.forward, data.order);
  const result: SortResult = { order: data.order, count, milliseconds: performance.now() - begin };
  self.postMessage(result, { transfer: [data.order.buffer] });
};
