// SPDX-License-Identifier: Apache-2.0
// The views of the two eyes in a headset. WebXR's axes are right, up and back, its unit is the metre.

import { Matrix4, Quaternion, Vector3 } from 'three';
import type { View } from '../camera/view';
import type { Vector } from '../format/vector';

const vector = (v: Vector3): Vector => [v.x, v.y, v.z];

/** Where the room of the headset is in the scene. */
export interface Place {
  /** Position of the room's origin. */
  position: Vector3;
  /** From the room's axes to those of the scene. */
  rotation: Quaternion;
  /** Units of the scene in a metre. */
  scale: number;
}

/** In the room. */
export const UP = new Vector3(0, 1, 0);
/** So far away in the room, in metres, is what the camera looks at when the headset is put on. */
const FOCUS = 2;

/** Where the head is in the room, and how it is turned. */
export interface Head {
  position: Vector3;
  orientation: Quaternion;
}

/**
 * The room as it is at first: it is level, and the head is where the camera is and looks where that looks to, but for
 * up and down.
 */
export function placeAt(position: Vector, target: Vector, up: Vector, head: Head): Place {
  const y = new Vector3(...up).normalize();
  const back = new Vector3(...position).sub(new Vector3(...target));
  const distance = back.length();
  back.addScaledVector(y, -back.dot(y));
  if (back.length() < 1e-3 * distance || distance === 0)
    back.set(Math.abs(y.x) < 0.9 ? 1 : 0, Math.abs(y.x) < 0.9 ? 0 : 1, 0).cross(y);
  back.normalize();
  const axes = new Matrix4().makeBasis(new Vector3().crossVectors(y, back), y, back);
  const ahead = new Vector3(0, 0, -1).applyQuaternion(head.orientation);
  const turned = new Quaternion().setFromAxisAngle(UP, Math.atan2(ahead.x, -ahead.z));
  const place = {
    position: new Vector3(),
    rotation: new Quaternion().setFromRotationMatrix(axes).multiply(turned),
    scale: Math.max(distance / FOCUS, 1e-3),
  };
  place.position.subVectors(new Vector3(...position), pointIn(place, head.position));
  return place;
}

/** A point of the room in the scene. */
export const pointIn = ({ position, rotation, scale }: Place, p: Vector3): Vector3 =>
  p.clone().multiplyScalar(scale).applyQuaternion(rotation).add(position);

/** Returns the view of an eye with so many pixels; `transform` and `projection` are WebXR's matrices. */
export function eyeView(
  place: Place,
  transform: ArrayLike<number>,
  projection: ArrayLike<number>,
  width: number,
  height: number,
): View {
  const eye = new Matrix4().fromArray(transform);
  const position = new Vector3().setFromMatrixPosition(eye);
  const [x, y, z] = [new Vector3(), new Vector3(), new Vector3()];
  eye.extractBasis(x, y, z);
  const [right, up, back] = [x, y, z].map((axis) => axis.normalize().applyQuaternion(place.rotation));
  return {
    right: vector(right),
    down: vector(up.negate()),
    forward: vector(back.negate()),
    position: vector(pointIn(place, position)),
    width,
    height,
    fx: (width / 2) * projection[0],
    fy: (height / 2) * projection[5],
    cx: (width / 2) * (1 - projection[8]),
    cy: (height / 2) * (1 + projection[9]),
  };
}

/** From between the eyes, all that any of them sees: what the Gaussians are sorted for. */
export function headView(eyes: readonly View[]): View {
  const most = (value: (view: View) => number) => Math.max(...eyes.map(value));
  const f = eyes[0].fx;
  const left = f * most((v) => v.cx / v.fx);
  const right = f * most((v) => (v.width - v.cx) / v.fx);
  const top = f * most((v) => v.cy / v.fy);
  const bottom = f * most((v) => (v.height - v.cy) / v.fy);
  const position = [0, 1, 2].map((k) => eyes.reduce((sum, eye) => sum + eye.position[k], 0) / eyes.length) as Vector;
  return { ...eyes[0], position, fx: f, fy: f, cx: left, cy: top, width: left + right, height: top + bottom };
}
