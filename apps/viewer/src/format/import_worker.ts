// SPDX-License-Identifier: Apache-2.0
// Reads a file of another program in a thread of its own: one message brings name and bytes, one answers.

import { FormatError, messageOf } from './cursor';
import { importScene } from './import';
import type { Imported } from './scene_packer';

export interface ImportRequest {
  name: string;
  buffer: ArrayBuffer;
}
export type ImportResult = Imported | { error: string; isFormatError: boolean };

self.onmessage = async ({ data: { name, buffer } }: MessageEvent<ImportRequest>) => {
  let result: ImportResult;
  let transfer: Transferable[] = [];
  try {
    result = await importScene(name, buffer);
    transfer = [result.scene.geometry, ...result.scene.payload.map(({ data }) => data)].map(
      ({ buffer: bytes }) => bytes as ArrayBuffer,
    );
  } catch (error) {
    result = { error: messageOf(error), isFormatError: error instanceof FormatError };
  }
  self.postMessage(result, { transfer });
};
