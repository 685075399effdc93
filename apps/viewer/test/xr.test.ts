// SPDX-License-Identifier: Apache-2.0
import { Matrix4, PerspectiveCamera, Quaternion, Vector3 } from 'three';
import { describe, expect, it } from 'vitest';
import { dot, minus, type Vector } from '../src/format/vector';
import { eyeView, headView, placeAt, pointIn } from '../src/xr/eyes';

const near = (seen: readonly number[], wanted: readonly number[]) =>
  seen.forEach((x, i) => expect(x).toBeCloseTo(wanted[i], 6));

const HEAD = { position: new Vector3(), orientation: new Quaternion() };

describe('the room of a headset', () => {
  it('is level, looks where the camera looks, and has what that looks at two metres away', () => {
    const place = placeAt([0, -1, -4], [0, 0, 0], [0, -1, 0], HEAD); // y down, as in 3DGS
    near(pointIn(place, new Vector3()).toArray(), [0, -1, -4]);
    const up = minus(pointIn(place, new Vector3(0, 1, 0)).toArray(), [0, -1, -4]);
    const ahead = minus(pointIn(place, new Vector3(0, 0, -2)).toArray(), [0, -1, -4]);
    near(up, [0, -Math.sqrt(17) / 2, 0]);
    near(ahead, [0, 0, Math.sqrt(17)]);
    expect(dot(up, ahead)).toBeCloseTo(0);
  });

  it('begins where the head is, and which way that is turned', () => {
    const head = {
      position: new Vector3(1, 1.6, 2),
      orientation: new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), 0.7),
    };
    const place = placeAt([0, 0, -4], [0, 0, 0], [0, -1, 0], head);
    const ahead = new Vector3(0, 0, -2).applyQuaternion(head.orientation).add(head.position);
    near(pointIn(place, head.position).toArray(), [0, 0, -4]);
    near(pointIn(place, ahead).toArray(), [0, 0, 0]);
  });

  it('has a front also where the camera looks straight down', () => {
    const { rotation } = placeAt([0, 0, 5], [0, 0, 0], [0, 0, 1], HEAD);
    near(new Vector3(0, 1, 0).applyQuaternion(rotation).toArray(), [0, 0, 1]);
  });
});

describe('an eye', () => {
  const place = placeAt([0, 0, -4], [0, 0, 0], [0, -1, 0], HEAD);
  const eye = (x: number, offset = 0) => {
    const camera = new PerspectiveCamera(90, 1, 0.1, 100);
    camera.projectionMatrix.elements[8] = offset;
    return eyeView(place, new Matrix4().makeTranslation(x, 0, 0).elements, camera.projectionMatrix.elements, 200, 200);
  };

  it('sees what a camera of the page sees', () => {
    const view = eye(0);
    near(view.position, [0, 0, -4]);
    near([...view.right, ...view.down, ...view.forward], [1, 0, 0, 0, 1, 0, 0, 0, 1]);
    near([view.fx, view.fy, view.cx, view.cy], [100, 100, 100, 100]);
  });

  it('is where it is in the room, with its own middle', () => {
    const view = eye(0.5, -0.2);
    near(view.position, [1, 0, -4]); // two units a metre
    near([view.cx, view.cy], [120, 100]);
  });

  it('has no more to see than the head', () => {
    const eyes = [eye(-0.03, -0.2), eye(0.03, 0.2)];
    const head = headView(eyes);
    near(head.position, [0, 0, -4]);
    near([head.fx, head.width, head.cx, head.height], [100, 240, 120, 200] satisfies number[]);
    expect(head.forward).toEqual<Vector>(eyes[0].forward);
  });
});
