// SPDX-License-Identifier: Apache-2.0
// Sorts in a thread of its own. A number begins anew and says how many Gaussians there will be. Then come parts of
// their geometry, and requests.

import type { View } from '../camera/view';
import { DepthSorter } from './sort';

export interface SortRequest {
  /** Comes back with the result: who has asked. */
  client: number;
  view: View;
  size: number;
  order: Uint32Array<ArrayBuffer>;
}
export interface SortResult {
  client: number;
  order: Uint32Array<ArrayBuffer>;
  count: number;
  milliseconds: number;
}

let sorter: DepthSorter | undefined;

self.onmessage = ({ data }: MessageEvent<number | Uint32Array | SortRequest>) => {
  if (typeof data === 'number') sorter = new DepthSorter(data);
  else if (data instanceof Uint32Array) sorter!.add(data);
  else {
    const begin = performance.now();
    const count = sorter!.sort(data.view, data.size, data.order);
    const result: SortResult = {
      client: data.client,
      order: data.order,
      count,
      milliseconds: performance.now() - begin,
    };
    self.postMessage(result, { transfer: [data.order.buffer] });
  }
};
