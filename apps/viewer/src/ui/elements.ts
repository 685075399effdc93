// SPDX-License-Identifier: Apache-2.0
/** The element of index.html with this id. */
export function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

/** Fills a <dl> with terms and what they are. */
export function fillList(id: string, rows: [string, string][]): void {
  element(id).replaceChildren(
    ...rows.flatMap(([term, value]) => {
      const dt = document.createElement('dt');
      const dd = document.createElement('dd');
      dt.textContent = term;
      dd.textContent = value;
      return [dt, dd];
    }),
  );
}

/** Hands the user a file. */
export function save(blob: Blob, name: string): void {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000); // the browser may still ask where to put it
}

/** The radio buttons of a group call `chosen` with the value. */
export function onChoice<T extends string>(name: string, chosen: (value: T) => void): void {
  for (const input of document.querySelectorAll<HTMLInputElement>(`input[name="${name}"]`))
    input.addEventListener('change', () => chosen(input.value as T));
}
