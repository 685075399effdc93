// SPDX-License-Identifier: Apache-2.0
// The benchmark's button, its result as text, and the same as JSON to save.

import type { BenchmarkResult } from '../benchmark';
import { element } from './elements';

type Run = (framesPerView: number, progress: (part: number) => void) => Promise<BenchmarkResult>;

export class BenchmarkPanel {
  private readonly button = element<HTMLButtonElement>('benchmark');
  private readonly output = element<HTMLOutputElement>('benchmark-result');
  private readonly link = element<HTMLAnchorElement>('benchmark-json');

  constructor(run: Run) {
    const repeats = element<HTMLInputElement>('repeats');
    this.button.addEventListener('click', async () => {
      if (!repeats.reportValidity()) return;
      this.button.disabled = true;
      try {
        this.show(await run(repeats.valueAsNumber, (part) => (this.output.value = `${Math.round(100 * part)} %`)));
      } catch (error) {
        this.output.value = `Stopped: ${(error as Error).message}`;
      } finally {
        this.button.disabled = false;
      }
    });
  }

  private show(result: BenchmarkResult): void {
    const ms = (x: number) => `${x.toFixed(2)} ms`;
    this.output.value = `Frame ${ms(result.frame.mean)} (median ${ms(result.frame.median)}, ${ms(result.frame.min)} to ${ms(result.frame.max)})\nColours alone ${ms(result.prepass.mean)}\n${result.way} on ${result.renderer}`;
    URL.revokeObjectURL(this.link.href);
    this.link.href = URL.createObjectURL(new Blob([JSON.stringify(result, null, 2)], { type: 'application/json' }));
    this.link.hidden = false;
  }

  clear(): void {
    this.output.value = '';
    this.link.hidden = true;
  }
}
