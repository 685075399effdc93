// SPDX-License-Identifier: Apache-2.0
// A camera: pose and pinhole intrinsics. OpenCV axes as in gsapp: x right, y down, z forward;
// pixel centres at .5.

import type { TestCamera } from '../format/ngsplat';
import { dot, type Vector } from '../format/vector';

export type View = TestCamera;

/** cam_from_world: the rotation column by column, as GLSL takes it, and the translation. */
export function camFromWorld(view: View): { rotation: number[]; translation: Vector } {
  const { right: x, down: y, forward: z, position: p } = view;
  return {
    rotation: [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]],
    translation: [-dot(x, p), -dot(y, p), -dot(z, p)],
  };
}

/** The same pose on `width` x `height` pixels: all of the view is seen, as large as fits, centred. */
export function fitView(view: View, width: number, height: number): View {
  const s = Math.min(width / view.width, height / view.height);
  return {
    ...view,
    width,
    height,
    fx: s * view.fx,
    fy: s * view.fy,
    cx: s * view.cx + (width - s * view.width) / 2,
    cy: s * view.cy + (height - s * view.height) / 2,
  };
}

/**
 * The same pose and intrinsics in pixels on another size: cropped or extended at the right and the bottom, never
 * scaled.
 */
export function cropView(view: View, width: number, height: number): View {
  return { ...view, width, height };
}

/** The vertical field of view in degrees. */
export const fovOf = (view: View): number => (360 / Math.PI) * Math.atan(view.height / 2 / view.fy);

/** The same with another one, and with pixels of the same shape. */
export function withFov(view: View, fov: number): View {
  const fy = view.height / 2 / Math.tan((fov * Math.PI) / 360);
  return { ...view, fy, fx: (view.fx * fy) / view.fy };
}
