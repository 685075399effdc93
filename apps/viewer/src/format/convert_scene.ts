// SPDX-License-Identifier: Apache-2.0
// From the bytes of another program's file to a scene: a worker converts them, so that the page stays awake.

import { FormatError } from './cursor';
import type { ImportRequest, ImportResult } from './import_worker';
import type { Imported } from './scene_packer';

/** Takes the bytes. Throws FormatError, which says what is wrong, and what `signal` is aborted with. */
export async function convertScene(name: string, buffer: ArrayBuffer, signal: AbortSignal): Promise<Imported> {
  const worker = new Worker(new URL('./import_worker.ts', import.meta.url), { type: 'module' });
  try {
    const result = await new Promise<ImportResult>((resolve, reject) => {
      worker.onmessage = ({ data }: MessageEvent<ImportResult>) => resolve(data);
      worker.onerror = (event) => reject(new Error(`reading it failed: ${event.message}`));
      signal.addEventListener('abort', () => reject(signal.reason as Error), { once: true });
      const request: ImportRequest = { name, buffer };
      worker.postMessage(request, [buffer]);
    });
    if (!('error' in result)) return result;
    throw result.isFormatError ? new FormatError(result.error) : new Error(result.error);
  } finally {
    worker.terminate();
  }
}
