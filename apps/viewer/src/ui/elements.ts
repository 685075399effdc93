// SPDX-License-Identifier: Apache-2.0
/** The element of index.html with this id. */
export function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

/** The radio buttons of a group call `chosen` with the value. */
export function onChoice<T extends string>(name: string, chosen: (value: T) => void): void {
  for (const input of document.querySelectorAll<HTMLInputElement>(`input[name="${name}"]`)) input.addEventListener('change', () => chosen(input.value as T));
}
