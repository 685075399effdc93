// SPDX-License-Identifier: Apache-2.0
// The part of the settings that speaks of the training: where it is, its curves and its buttons.

import { element, fillList } from '../ui/elements';
import { drawCurve } from './chart';
import type { Control, Curve, Status } from './status';

/** How long "Stop" waits for the second press. */
const CONFIRM_MILLISECONDS = 4000;

const count = (n: number): string => n.toLocaleString('en');

export function duration(seconds: number): string {
  const s = Math.round(seconds);
  if (s < 60) return `${s} s`;
  return s < 3600
    ? `${Math.floor(s / 60)} min ${s % 60} s`
    : `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
}

/** One sentence on where the training is. */
export function stateText(status: Status): string {
  const { state, iteration, iterations, message } = status;
  const of = iterations ? `${count(iteration)} of ${count(iterations)}` : count(iteration);
  const left = status.eta_seconds === undefined ? '' : `, ${duration(status.eta_seconds)} left`;
  const texts: Record<Status['state'], string> = {
    starting: 'Training begins.',
    training: `Iteration ${of}${left}`,
    paused: `Paused after iteration ${of}`,
    finished: `Finished after ${count(iteration)} iterations`,
    stopped: `Stopped: ${message ?? ''}`,
    failed: `Failed: ${message ?? ''}`,
    saved: iteration > 0 ? `Saved at iteration ${count(iteration)}` : 'Not trained here',
  };
  return texts[state] ?? state;
}

/** Returns the message for a gsapp that stopped answering so many seconds after it said `status`. */
export function lostText(status: Status | undefined, seconds: number): string {
  if (!status) return 'gsapp does not answer any more.';
  const isOver = ['finished', 'stopped', 'failed'].includes(status.state);
  const isDue = status.state === 'training' && seconds >= (status.eta_seconds ?? Infinity);
  const what = isOver
    ? stateText(status)
    : isDue
      ? 'gsapp has ended; by its last estimate, the training has finished'
      : 'gsapp does not answer any more';
  return `${what}. gsapp view ${status.run} shows what it saved.`;
}

/** `picture`: the iteration of the picture that is shown, if it is of this program. */
export function facts(status: Status, picture: number | undefined): [string, string][] {
  const {
    num_gaussians,
    iterations_per_second: speed,
    train_seconds,
    saved_iteration,
    save_pending,
    snapshot_error,
  } = status;
  return [
    ['Gaussians', count(num_gaussians)],
    ...(speed ? ([['Iterations per second', speed.toFixed(speed < 10 ? 1 : 0)]] as [string, string][]) : []),
    ...(train_seconds > 0 ? ([['Trained for', duration(train_seconds)]] as [string, string][]) : []),
    ...(picture !== undefined ? ([['Picture of iteration', count(picture)]] as [string, string][]) : []),
    ...(save_pending
      ? ([['Saved', 'at the next hundredth iteration']] as [string, string][])
      : saved_iteration
        ? ([['Saved', `iteration ${count(saved_iteration)}`]] as [string, string][])
        : []),
    ...(status.save_error ? ([['Not saved', status.save_error]] as [string, string][]) : []),
    ...(snapshot_error ? ([['No picture', snapshot_error]] as [string, string][]) : []),
  ];
}

const lastValue = (curve: Curve): number | undefined => curve.values.filter((value) => value !== null).at(-1);

export class LivePanel {
  private readonly state = element('live-state');
  private readonly pause = element<HTMLButtonElement>('live-pause');
  private readonly save = element<HTMLButtonElement>('live-save');
  private readonly stop = element<HTMLButtonElement>('live-stop');
  private status: Status | undefined;
  private heardAt = 0;
  /** What is shown: the program that sent it, and its iteration. */
  private picture: { id: string; iteration: number } | undefined;
  private confirming: ReturnType<typeof setTimeout> | undefined;

  constructor(control: (control: Control) => void) {
    element('live').hidden = false;
    this.pause.addEventListener('click', () => control(this.status?.state === 'paused' ? 'continue' : 'pause'));
    this.save.addEventListener('click', () => control('save'));
    this.stop.addEventListener('click', () => {
      const confirmed = this.confirming !== undefined;
      this.unconfirm();
      if (confirmed) return control('stop');
      this.stop.textContent = 'Really stop?';
      this.confirming = setTimeout(() => this.unconfirm(), CONFIRM_MILLISECONDS);
    });
  }

  private unconfirm(): void {
    clearTimeout(this.confirming);
    this.confirming = undefined;
    this.stop.textContent = 'Stop';
  }

  /** `mayControl`: whether this page has the token. */
  show(status: Status, mayControl: boolean): void {
    this.status = status;
    this.heardAt = Date.now();
    this.setState(stateText(status));
    this.showFacts();
    this.showCurve('live-loss', status.loss_curve, (loss) => `Loss ${loss.toFixed(4)}`);
    this.showCurve('live-psnr', status.psnr_curve, (psnr) => `PSNR ${psnr.toFixed(2)} dB, ${status.psnr_of}`);
    const runs = status.state === 'training' || status.state === 'paused' || status.state === 'starting';
    element('live-buttons').hidden = !(status.controls && mayControl && runs);
    this.pause.textContent = status.state === 'paused' ? 'Continue' : 'Pause';
    this.save.disabled = status.save_pending;
  }

  private showFacts(): void {
    if (this.status)
      fillList(
        'live-info',
        facts(this.status, this.picture?.id === this.status.id ? this.picture.iteration : undefined),
      );
  }

  /** Another picture is shown, which the program `id` sent. */
  showPicture(id: string, iteration: number): void {
    this.picture = { id, iteration };
    this.showFacts();
  }

  private showCurve(id: string, curve: Curve, text: (value: number) => string): void {
    const last = lastValue(curve);
    const figure = element(id);
    figure.hidden = last === undefined;
    if (last === undefined) return;
    figure.querySelector('figcaption')!.textContent = text(last);
    drawCurve(
      figure.querySelector('svg')!,
      curve,
      `${text(last)}, over iterations ${curve.iterations[0]} to ${curve.iterations.at(-1)}`,
    );
  }

  /** Only what changed is read aloud. */
  private setState(text: string): void {
    if (this.state.textContent !== text) this.state.textContent = text;
  }

  showLost(): void {
    element('live-buttons').hidden = true;
    this.setState(lostText(this.status, (Date.now() - this.heardAt) / 1000));
  }

  /** What came of the last press of a button; empty where there is nothing to say. */
  say(text: string): void {
    element('live-message').textContent = text;
  }
}
