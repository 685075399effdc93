// SPDX-License-Identifier: Apache-2.0
// What draws a scene, by WebGL2 or by WebGPU.

import type { View } from '../camera/view';
import type { Scene } from '../format/ngsplat';
import type { Plane } from '../format/reader';
import type { Vector } from '../format/vector';
import type { Mode } from './prepass';
import type { SplatStyle } from './splats';
import type { Precision } from './target';

/** Has a message for the user. */
export class RenderError extends Error {}

export interface Picture {
  mode: Mode;
  background: Vector;
  splats: SplatStyle;
  /** Exposure and latents, where the picture is to be corrected. */
  exposure?: Float32Array;
}

export interface SceneRenderer {
  readonly way: 'WebGL2' | 'WebGPU';
  /** Where pictures are shown. */
  readonly canvas: HTMLCanvasElement;
  /** Whether every picture is sorted by itself; otherwise setOrder says the order. */
  readonly sortsItself: boolean;
  /** The best that this device can draw into. */
  readonly precision: Precision;
  /** Gaussians in the last picture of which this is known. */
  readonly drawn: number;
  /** Bytes on the GPU beside the picture itself. */
  readonly bytes: number;
  readonly deviceName: string;
  /** What `timeFrame` and `timeColors` do. */
  readonly benchmarkProtocol: string;

  /** Of the canvas. */
  setSize(width: number, height: number): void;
  /** Replaces what is shown by a scene whose texels follow. Throws Error where the device cannot hold or draw it. */
  beginScene(scene: Scene): void;
  /** Rows of a texture of the scene. Its Gaussians are shown in their base colours until it is complete. */
  addRows(plane: Plane, row: number, texels: Uint32Array): void;
  /** All texels of the scene are there. */
  completeScene(): void;
  clearScene(): void;
  /** Lets go of everything on a device that was lost, or that is no longer used. */
  forget(): void;
  /** The next pictures draw the first `count` of `order`. Returns the array that is no longer needed. */
  setOrder(order: Uint32Array, count: number): Uint32Array;
  /** The order of the last picture. */
  order(): Promise<Uint32Array>;
  render(view: View, picture: Picture): void;
  /** The picture's bytes, rgba from the upper left. */
  renderPixels(view: View, picture: Picture, precision?: Precision): Promise<Uint8Array>;
  /** Draws a frame, or colours alone, with eight bits, and waits until they are there. */
  timeFrame(view: View): Promise<void>;
  timeColors(view: View): Promise<void>;
}
