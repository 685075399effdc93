// SPDX-License-Identifier: Apache-2.0
// Reads the title and start view that `gsapp export` wrote into the page (docs/formats.md#the-folder-of-a-site).

import { parseAddress, type Address } from './address';

const content = (name: string): string | undefined =>
  document.querySelector<HTMLMetaElement>(`meta[name="gsapp:${name}"]`)?.content;
const start = content('start');

export const PAGE: { title?: string; start?: Address } = {
  title: content('title'),
  start: start === undefined ? undefined : parseAddress(start),
};
