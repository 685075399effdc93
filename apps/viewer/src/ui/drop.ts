// SPDX-License-Identifier: Apache-2.0
// Files from the user: dropped on the page, or chosen.

import type { Source } from '../format/load';
import { partsOf } from '../format/parts';
import { element } from './elements';

function fileSource(file: File): Source {
  return { name: file.name, size: file.size, parts: partsOf(file.stream()) };
}

/**
 * `opened` gets what reads a file from its beginning, as often as called. Undefined where files cannot be shown: then a
 * dropped one does not replace the page.
 */
export function onFile(opened: ((source: () => Promise<Source>) => void) | undefined): void {
  const input = element<HTMLInputElement>('file');
  const overlay = element('drop');
  const open = (file: File) => opened?.(() => Promise.resolve(fileSource(file)));
  for (const id of ['open', 'open-notice']) element(id).addEventListener('click', () => input.click());
  input.addEventListener('change', () => {
    if (input.files?.[0]) open(input.files[0]);
    input.value = ''; // the same file may be opened again
  });
  const carriesFile = (event: DragEvent) => event.dataTransfer?.types.includes('Files') ?? false;
  addEventListener('dragover', (event) => {
    if (!carriesFile(event)) return;
    event.preventDefault();
    overlay.hidden = opened === undefined;
  });
  addEventListener('dragleave', (event) => {
    if (!event.relatedTarget) overlay.hidden = true; // left the window
  });
  addEventListener('drop', (event) => {
    event.preventDefault();
    overlay.hidden = true;
    const file = event.dataTransfer?.files[0];
    if (file) open(file);
  });
}
