// SPDX-License-Identifier: Apache-2.0
// The appearance models that this viewer can draw: every GLSL file of the folders appearance/<name>/.
//
// A file says with `#pragma ngsplat ID NAME [HALVES]` which model of the .ngsplat format it evaluates, and how many half-precision
// numbers a site or lobe of it takes.

export interface ModelCode {
  id: number;
  name: string;
  /** Half-precision numbers per site or lobe; undefined where the format packs a model in a way of its own. */
  halvesPerUnit?: number;
  glsl: string;
}

const files = import.meta.glob('../../../appearance/*/*.glsl', { query: '?raw', import: 'default', eager: true }) as Record<string, string>;

/** By model number. */
export const models: ReadonlyMap<number, ModelCode> = new Map(
  Object.values(files).flatMap((text) =>
    [...text.matchAll(/^#pragma ngsplat (\d+) (\w+)(?: (\d+))?$/gm)].map(([, id, name, halves]) => {
      const glsl = text.replace(/^#pragma ngsplat.*$/gm, '');
      return [Number(id), { id: Number(id), name, halvesPerUnit: halves ? Number(halves) : undefined, glsl }] as const;
    }),
  ),
);
