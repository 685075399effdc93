// SPDX-License-Identifier: Apache-2.0
// The appearance models that this viewer can draw: every packing.json of the folders appearance/<name>/, with the GLSL
// file that it names.

import type { PackingDescription } from './format/packing';

export interface ModelCode {
  packing: PackingDescription;
  glsl: string;
}

// '@more-models' is the folder that GSAPP_MORE_MODELS names, or the same as the first (vite.config.ts).
const descriptions = import.meta.glob(['../../../appearance/*/packing.json', '@more-models/*/packing.json'], {
  import: 'default',
  eager: true,
}) as Record<string, PackingDescription | PackingDescription[]>;
const shaders = import.meta.glob(['../../../appearance/*/*.glsl', '@more-models/*/*.glsl'], {
  query: '?raw',
  import: 'default',
  eager: true,
}) as Record<string, string>;

function modelsOf(file: string, content: PackingDescription | PackingDescription[]): ModelCode[] {
  return [content].flat().map((packing) => {
    const glsl = shaders[file.replace('packing.json', packing.glsl)];
    if (glsl === undefined) throw new Error(`${file} names ${packing.glsl}, which is not there`);
    return { packing, glsl };
  });
}

/** By model number. */
export const models: ReadonlyMap<number, ModelCode> = new Map(
  Object.entries(descriptions)
    .flatMap(([file, content]) => modelsOf(file, content))
    .map((model) => [model.packing.id, model]),
);
