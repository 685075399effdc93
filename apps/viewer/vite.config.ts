// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from 'node:fs';
import { fileURLToPath } from 'node:url';
import { defineConfig } from 'vitest/config';
import type { Plugin } from 'vite';

/** The notice of what is bundled, beside the bundle. */
const licenses: Plugin = {
  name: 'licenses',
  apply: 'build',
  generateBundle() {
    const notice = (name: string, folder: string, address: string) =>
      `This page contains ${name} (${address}):\n\n${readFileSync(new URL(`node_modules/${folder}/LICENSE`, import.meta.url), 'utf8')}`;
    const notices = [
      notice('three.js', 'three', 'https://threejs.org'),
      notice('fzstd', 'fzstd', 'https://github.com/101arrowz/fzstd'),
    ];
    this.emitFile({ type: 'asset', fileName: 'LICENSES.txt', source: notices.join('\n') });
  },
};

/** A further folder of models' folders, for tests: each with packing.json and GLSL like those of appearance/. */
const moreModels = process.env.GSAPP_MORE_MODELS ?? fileURLToPath(new URL('../../appearance', import.meta.url));

export default defineConfig({
  resolve: { alias: { '@more-models': moreModels } },
  base: './', // works below any path
  plugins: [licenses],
  build: { target: 'es2022', chunkSizeWarningLimit: 1000, assetsInlineLimit: 0, modulePreload: { polyfill: false } },
  worker: { format: 'es' },
  server: { fs: { allow: ['../..'] } }, // the models' GLSL lies in appearance/
  test: { include: ['test/**/*.test.ts'] },
});
