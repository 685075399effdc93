// SPDX-License-Identifier: Apache-2.0
// Which view is shown: a test view or a frame of a path exactly, until the user moves; then the pose that moving led to.

import { PerspectiveCamera, Vector3 } from 'three';
import type { Scene } from '../format/ngsplat';
import { dot, type Vector } from '../format/vector';
import type { Extent } from './extent';
import { Fly, Orbit, type Movement } from './movement';
import { fitView, fovOf, withFov, type View } from './view';

/** Vertical field of view of a scene without test views. */
const DEFAULT_FOV = 60;

/** Around the centres of the Gaussians, for their own size. */
const MARGIN = 1.15;

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
  /** Whether this is the view that the model is first shown with. */
  isFirst = true;
  /** Another view that is. */
  private exact: View | undefined;

  constructor(private scene: Scene, canvas: HTMLCanvasElement, changed: () => void) {
    this.camera.up.set(...scene.up).normalize();
    const moved = () => {
      this.unpin();
      changed();
    };
    this.orbit = new Orbit(this.camera, canvas, moved);
    this.movements = { orbit: this.orbit, fly: new Fly(this.camera, canvas, 0.5 * Math.max(scene.distance, 1e-3), moved) };
    this.lens = defaultView(scene);
    this.reset();
  }

  /** The first test view, or what stands for it. */
  reset(): void {
    if (this.scene.testCameras.length) this.pin(0);
    else this.show(defaultView(this.scene));
    this.isFirst = true;
  }

  private show(view: View, focus?: number): void {
    const { camera } = this;
    this.unpin();
    this.lens = view;
    camera.fov = fovOf(view);
    camera.position.set(...view.position);
    camera.lookAt(new Vector3(...view.forward).add(camera.position));
    this.movements[this.movement].end();
    this.movements[this.movement].begin(focus ?? this.focus());
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
    this.pinned = this.exact = undefined;
    this.isFirst = false;
  }

  /** Shows this pose and lens, roll included. */
  showExactly(view: View): void {
    this.show(view);
    this.exact = view;
  }

  /** Looks from one point to another; `fov` is the vertical one in degrees. */
  look(from: Vector, to: Vector, fov = this.fov): void {
    const offset = new Vector3(...to).sub(new Vector3(...from)), distance = offset.length();
    this.show({ ...withFov(this.lens, fov), position: from, forward: vector(offset.divideScalar(distance)) }, distance);
  }

  /** Goes back or forth until a sphere fills the view. */
  frame({ center, radius }: Extent): void {
    const { lens } = this, { forward } = this.current();
    const half = Math.atan(Math.min(lens.width / 2 / lens.fx, lens.height / 2 / lens.fy));
    const distance = (MARGIN * Math.max(radius, 1e-3)) / Math.sin(half);
    this.look(center.map((c, i) => c - distance * forward[i]) as Vector, center);
  }

  /** The point that is looked at. */
  get target(): Vector {
    if (this.movement === 'orbit') return vector(this.orbit.target);
    const { forward, position } = cameraPose(this.camera), focus = this.focus();
    return position.map((p, i) => p + focus * forward[i]) as Vector;
  }

  get fov(): number {
    return fovOf(this.lens);
  }

  setMovement(name: MovementName): void {
    this.movements[this.movement].end();
    this.movement = name;
    this.movements[name].begin(this.focus());
  }

  /** What is shown, at the size that its lens came with. */
  current(): View {
    const exact = this.pinned === undefined ? this.exact : this.scene.testCameras[this.pinned];
    return exact ?? { ...this.lens, ...cameraPose(this.camera), cx: this.lens.width / 2, cy: this.lens.height / 2 };
  }

  /** What to draw on so many pixels. */
  view(width: number, height: number): View {
    return fitView(this.current(), width, height);
  }

  dispose(): void {
    this.movements.fly.end();
    this.orbit.dispose();
  }
}
