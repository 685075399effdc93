// SPDX-License-Identifier: Apache-2.0
// Which view is shown: a test view exactly, until the user moves; then the pose that moving led to.

import { PerspectiveCamera, Vector3 } from 'three';
import type { Scene } from '../format/ngsplat';
import { dot, type Vector } from '../format/vector';
import { Fly, Orbit, type Movement } from './movement';
import { fitView, type View } from './view';

/** Vertical field of view of a scene without test views. */
const DEFAULT_FOV = 60;

export type MovementName = 'orbit' | 'fly';

const vector = (v: Vector3): Vector => [v.x, v.y, v.z];

/** The pose of a three.js camera, which looks along -z with y up. */
export function cameraPose(camera: PerspectiveCamera): Pick<View, 'right' | 'down' | 'forward' | 'position'> {
  camera.updateMatrixWorld();
  const [x, y, z] = [new Vector3(), new Vector3(), new Vector3()];
  camera.matrixWorld.extractBasis(x, y, z);
  return { right: vector(x), down: vector(y.negate()), forward: vector(z.negate()), position: vector(camera.position) };
}

/** A view for scenes without any: the centre from the given distance, level. */
export function defaultView(scene: Scene): View {
  const camera = new PerspectiveCamera(DEFAULT_FOV);
  camera.up.set(...scene.up).normalize();
  const center = new Vector3(...scene.center);
  const side = new Vector3(1, 0, 0).cross(camera.up).lengthSq() > 0.1 ? new Vector3(1, 0, 0) : new Vector3(0, 1, 0);
  side.addScaledVector(camera.up, -side.dot(camera.up)).normalize(); // level
  camera.position.copy(center).addScaledVector(side, scene.distance);
  camera.lookAt(center);
  const height = 720, focal = height / 2 / Math.tan((DEFAULT_FOV * Math.PI) / 360);
  return { ...cameraPose(camera), fx: focal, fy: focal, cx: 640, cy: 360, width: 1280, height };
}

export class Navigator {
  private readonly camera = new PerspectiveCamera();
  private readonly orbit: Orbit;
  private readonly movements: Record<MovementName, Movement>;
  private movement: MovementName = 'orbit';
  private lens: View;
  /** The test view that is shown exactly. */
  pinned: number | undefined;

  constructor(private scene: Scene, canvas: HTMLCanvasElement, changed: () => void) {
    this.camera.up.set(...scene.up).normalize();
    const moved = () => {
      this.unpin();
      changed();
    };
    this.orbit = new Orbit(this.camera, canvas, moved);
    this.movements = { orbit: this.orbit, fly: new Fly(this.camera, canvas, 0.5 * Math.max(scene.distance, 1e-3), moved) };
    this.lens = scene.testCameras[0] ?? defaultView(scene);
    this.show(this.lens);
    if (scene.testCameras.length) this.pinned = 0;
  }

  private show(view: View): void {
    const { camera } = this;
    this.lens = view;
    camera.fov = (360 / Math.PI) * Math.atan(view.height / 2 / view.fy);
    camera.position.set(...view.position);
    camera.lookAt(new Vector3(...view.forward).add(camera.position));
    this.movements[this.movement].end();
    this.movements[this.movement].begin(this.focus());
  }

  /** Distance at which the scene's centre lies in the direction looked at. */
  private focus(): number {
    const { forward, position } = cameraPose(this.camera);
    const offset = this.scene.center.map((c, i) => c - position[i]) as Vector;
    return Math.max(dot(offset, forward), 0.1 * this.scene.distance, 1e-3);
  }

  /** Goes on with a newer state of the model, from where the camera is. */
  setScene(scene: Scene): void {
    this.scene = scene;
    if (this.pinned !== undefined && this.pinned >= scene.testCameras.length) this.unpin();
  }

  pin(index: number): void {
    this.show(this.scene.testCameras[index]);
    this.pinned = index;
  }

  unpin(): void {
    this.pinned = undefined;
  }

  setMovement(name: MovementName): void {
    this.movements[this.movement].end();
    this.movement = name;
    this.movements[name].begin(this.focus());
  }

  /** What to draw on so many pixels. */
  view(width: number, height: number): View {
    if (this.pinned !== undefined) return fitView(this.scene.testCameras[this.pinned], width, height);
    return fitView({ ...this.lens, ...cameraPose(this.camera), cx: this.lens.width / 2, cy: this.lens.height / 2 }, width, height);
  }

  dispose(): void {
    this.movements.fly.end();
    this.orbit.dispose();
  }
}
