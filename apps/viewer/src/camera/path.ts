// SPDX-License-Identifier: Apache-2.0
// Ways of the camera through time: along keyframes, and around a point.

import { CatmullRomCurve3, Matrix4, Quaternion, Vector3 } from 'three';
import type { Vector } from '../format/vector';
import type { View } from './view';

/** What is shown at a time from 0 to 1. */
export type CameraPath = (time: number) => View;

const vector = (v: Vector3): Vector => [v.x, v.y, v.z];
const mix = (a: number, b: number, t: number): number => a + t * (b - a);

function orientation(view: View): Quaternion {
  const [right, down, forward] = [view.right, view.down, view.forward].map((axis) => new Vector3(...axis));
  return new Quaternion().setFromRotationMatrix(new Matrix4().makeBasis(right, down, forward));
}

function axes(q: Quaternion): Pick<View, 'right' | 'down' | 'forward'> {
  const [right, down, forward] = [new Vector3(1, 0, 0), new Vector3(0, 1, 0), new Vector3(0, 0, 1)].map((axis) =>
    vector(axis.applyQuaternion(q)),
  );
  return { right, down, forward };
}

/**
 * Goes through at least one keyframe, as long from each to the next: positions on a Catmull-Rom curve, rotations
 * slerped. All has the first one's size.
 */
export function keyframePath(keyframes: readonly View[]): CameraPath {
  const curve = new CatmullRomCurve3(
    keyframes.map(({ position }) => new Vector3(...position)),
    false,
    'centripetal',
  );
  const rotations = keyframes.map(orientation);
  const { width, height } = keyframes[0];
  return (time) => {
    const at = time * (keyframes.length - 1);
    const k = Math.min(Math.floor(at), keyframes.length - 2);
    const t = at - k;
    if (k < 0) return keyframes[0];
    const [a, b] = [keyframes[k], keyframes[k + 1]];
    const fy = height * mix(a.fy / a.height, b.fy / b.height, t);
    return {
      ...axes(rotations[k].clone().slerp(rotations[k + 1], t)),
      position: vector(curve.getPoint(time)),
      fy,
      fx: fy * mix(a.fx / a.fy, b.fx / b.fy, t),
      cx: width / 2,
      cy: height / 2,
      width,
      height,
    };
  };
}

/** Goes once around the vertical axis through `center`. */
export function turntable(view: View, center: Vector, up: Vector): CameraPath {
  const axis = new Vector3(...up).normalize();
  const middle = new Vector3(...center);
  const offset = new Vector3(...view.position).sub(middle);
  const start = orientation(view);
  return (time) => {
    const turn = new Quaternion().setFromAxisAngle(axis, 2 * Math.PI * time);
    return {
      ...view,
      ...axes(turn.clone().multiply(start)),
      position: vector(offset.clone().applyQuaternion(turn).add(middle)),
    };
  };
}

/** One view of a path, and whether it is a keyframe. */
export interface PathFrame {
  view: View;
  keyframe: boolean;
}

/** The pictures of a path: about so many, and one at every keyframe. */
export function pathFrames(keyframes: readonly View[], count: number): PathFrame[] {
  const path = keyframePath(keyframes);
  const gaps = keyframes.length - 1;
  const each = gaps > 0 ? Math.max(1, Math.round((count - 1) / gaps)) : 0;
  return Array.from({ length: gaps * each + 1 }, (_, i) => ({
    view: path(i / Math.max(1, gaps * each)),
    keyframe: each === 0 || i % each === 0,
  }));
}
