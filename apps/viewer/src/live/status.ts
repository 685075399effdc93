// SPDX-License-Identifier: Apache-2.0
// What gsapp says of a training that it serves (docs/formats.md#the-live-page).

export interface Curve {
  iterations: number[];
  values: (number | null)[];
}

export interface Status {
  /** Another one after the program was started anew. */
  id: string;
  scene: string;
  appearance: string;
  run: string;
  state: 'starting' | 'training' | 'paused' | 'finished' | 'stopped' | 'failed' | 'saved';
  message?: string;
  /** Whether this page may use the buttons. */
  controls: boolean;
  iteration: number;
  iterations?: number;
  num_gaussians: number;
  train_seconds: number;
  loss?: number | null;
  iterations_per_second?: number;
  eta_seconds?: number;
  save_pending: boolean;
  saved_iteration?: number;
  /** Empty where saving went well. */
  save_error?: string;
  snapshot_error?: string | null;
  model: { version: number; iteration: number; url: string } | null;
  photographs: number;
  loss_curve: Curve;
  psnr_curve: Curve;
  psnr_of: string;
}

export const CONTROLS = ['pause', 'continue', 'save', 'stop'] as const;
export type Control = (typeof CONTROLS)[number];

/** Throws where nobody answers, or not as gsapp does. */
export async function fetchStatus(): Promise<Status> {
  const response = await fetch('live/status.json', { signal: AbortSignal.timeout(10_000) });
  if (!response.ok) throw new Error(`the server answers ${response.status}`);
  const status = (await response.json()) as Status;
  if (typeof status?.id !== 'string' || typeof status.state !== 'string') throw new Error('the server is not gsapp');
  return status;
}

/** Returns whether gsapp took it. */
export async function sendControl(control: Control, token: string): Promise<boolean> {
  const response = await fetch(`live/${control}`, { method: 'POST', headers: { 'X-Gsapp-Token': token } });
  return response.ok;
}
