// SPDX-License-Identifier: Apache-2.0
// Reads a file of any format that the viewer knows, and hands on its Gaussians.

import { convertScene } from './convert_scene';
import { isNgsplat } from './import';
import { inSteps, peekHead, readAll, readParts, type Source } from './load';
import { SceneCollector, SceneReader, texelsOf, type SceneSink } from './reader';

export interface ModelRead {
  /** Bytes of the file. */
  bytes: number;
  /** What the user should know of what was read. */
  remarks: string[];
}

export interface ReadOptions {
  /**
   * The sink gets nothing before the file is known to be good as a whole. Files of other programs are always read so.
   */
  whole: boolean;
  /** Bytes so far, and of all as far as known. */
  progress: (bytes: number, size?: number) => void;
  signal: AbortSignal;
}

/**
 * Hands what the file has to `sink`: while it arrives, or all at its end. Throws FormatError, which says what is wrong,
 * and what `signal` is aborted with.
 */
export async function readModel(
  file: Source,
  sink: SceneSink,
  { whole, progress, signal }: ReadOptions,
): Promise<ModelRead> {
  const { head, source } = await peekHead(file);
  const { name, size } = source;
  signal.throwIfAborted();
  const handOn = async (scene: Parameters<SceneSink['begin']>[0]) => {
    signal.throwIfAborted();
    sink.begin(scene);
    await inSteps(texelsOf(scene), (part) => {
      signal.throwIfAborted();
      sink.rows(...part);
    });
    signal.throwIfAborted();
  };
  if (!isNgsplat(name, head)) {
    const buffer = await readAll(source, (bytes) => {
      signal.throwIfAborted();
      progress(bytes, size);
    });
    const { byteLength } = buffer;
    const { scene, remarks } = await convertScene(name, buffer, signal); // takes the bytes
    await handOn(scene);
    return { bytes: byteLength, remarks };
  }
  const reader = new SceneReader(whole ? new SceneCollector() : sink, size);
  await readParts(source, (part) => {
    signal.throwIfAborted();
    reader.push(part);
    progress(reader.bytes, reader.end ?? size);
  });
  const scene = reader.finish();
  if (whole) await handOn(scene);
  signal.throwIfAborted();
  return { bytes: reader.bytes, remarks: [] };
}
