// SPDX-License-Identifier: Apache-2.0
// What the user chose about the picture, whatever the model.

import type { AxisName, MovementName } from './camera/navigator';
import type { Vector } from './format/vector';
import type { Mode } from './render/prepass';

export interface Settings {
  mode: Mode;
  /** Whether the camera's exposure and colour are applied, where the file has them. */
  photometric: boolean;
  movement: MovementName;
  /** The axis that points up. Undefined: as the file says. */
  up: AxisName | undefined;
  /** Undefined: the file's own. */
  background: Vector | undefined;
  /** A factor of the Gaussians' scales. */
  splatSize: number;
  /** Whether every Gaussian is a dot. */
  points: boolean;
  /** Depth below which nothing is drawn, in the model's units. */
  near: number;
  /** Which level of the model is shown, 0 the finest. Undefined: what suits the device. */
  detail: number | undefined;
  /** Whether the settings are open beside the picture. Undefined: as the page begins. */
  panel: boolean | undefined;
}

export const DEFAULTS: Readonly<Settings> = {
  mode: 'full',
  photometric: true,
  movement: 'orbit',
  up: undefined,
  background: undefined,
  splatSize: 1,
  points: false,
  near: 0,
  detail: undefined,
  panel: undefined,
};
export const SPLAT_SIZES = { least: 0.1, most: 2 };
