// SPDX-License-Identifier: Apache-2.0
// Which view is shown: a test view or a frame of a path exactly, until the user moves; then the pose that moving led
// to.

import { MathUtils, PerspectiveCamera, Vector3 } from 'three';
import type { AddressCamera } from '../address';
import type { Scene } from '../format/ngsplat';
import { dot, minus, type Vector } from '../format/vector';
import type { Extent, ModelSample } from './extent';
import { Fly, Orbit, type Movement } from './movement';
import { fitView, fovOf, withFov, type View } from './view';

/** The lens of a scene without test views: its vertical field of view in degrees, and its size. */
const DEFAULT_FOV = 60;
const DEFAULT_SIZE = { width: 1280, height: 720 };
/** By how many degrees the first view of such a scene looks down. */
const DOWN = 10;

/** Around the sphere that is to be seen. */
const MARGIN = 1.15;
/** Share of the picture that may hide the middle, and the degrees to look down by if more does. */
const MOST_COVERED = 0.25;
const STEEPER = [30, 55, 80];

/** Photographs that are turned by less stand upright; one that looks nearly up or down has no upright. */
const MOST_ROLL = 10;
const LEAST_UPRIGHT = 0.3;

/** A look that turns to another point takes so many milliseconds. */
const TURN = 350;

export type MovementName = 'orbit' | 'fly';
export const AXES = ['x', '-x', 'y', '-y', 'z', '-z'] as const;
export type AxisName = (typeof AXES)[number];

/** Calls by which a navigator tells the page of changes. */
export interface NavigatorEvents {
  /** The user has moved the camera. */
  changed(): void;
  /** Flying goes at another factor of the usual speed. */
  faster(factor: number): void;
}

const vector = (v: Vector3): Vector => [v.x, v.y, v.z];

/** The pose of a three.js camera, which looks along -z with y up. */
export function cameraPose(camera: PerspectiveCamera): Pick<View, 'right' | 'down' | 'forward' | 'position'> {
  camera.updateMatrixWorld();
  const [x, y, z] = [new Vector3(), new Vector3(), new Vector3()];
  camera.matrixWorld.extractBasis(x, y, z);
  return { right: vector(x), down: vector(y.negate()), forward: vector(z.negate()), position: vector(camera.position) };
}

/** The direction of an axis: `z`, or `-z` for the other way. */
export function axisOf(name: AxisName): Vector {
  return ['x', 'y', 'z'].map((axis) => (name.endsWith(axis) ? (name.startsWith('-') ? -1 : 1) : 0)) as Vector;
}

/**
 * Where a model's front faces by custom, level: towards +z where +y is up (glTF), -z where -y is (COLMAP and 3DGS), -y
 * where z is (CAD and Blender).
 */
export function frontOf(up: Vector): Vector {
  const [, y, z] = up.map(Math.abs);
  const upright = new Vector3(...up).normalize();
  const front =
    z > y && z > Math.abs(up[0])
      ? new Vector3(0, -Math.sign(up[2]), 0)
      : new Vector3(0, 0, up[1] < -Math.abs(up[0]) ? -1 : 1);
  return vector(front.addScaledVector(upright, -front.dot(upright)).normalize());
}

/**
 * A direction that looks down by so many degrees, above where `forward` looks to, or anywhere if that is up or down
 * itself.
 */
export function lookDown(forward: Vector, up: Vector, degrees: number): Vector {
  const upright = new Vector3(...up).normalize();
  const level = new Vector3(...forward);
  level.addScaledVector(upright, -level.dot(upright));
  if (level.lengthSq() < 1e-6) level.set(...frontOf(up)).negate();
  const angle = MathUtils.degToRad(degrees);
  return vector(level.normalize().multiplyScalar(Math.cos(angle)).addScaledVector(upright, -Math.sin(angle)));
}

/**
 * The angle in degrees by which a view is turned about its axis from where `up` is up in it; 0 if it looks up or down.
 */
export function rollOf({ right, down }: View, up: Vector): number {
  const x = dot(up, right);
  const y = -dot(up, down);
  return Math.hypot(x, y) < LEAST_UPRIGHT * Math.hypot(...up) ? 0 : MathUtils.radToDeg(Math.atan2(-x, y));
}

export class Navigator {
  private readonly camera = new PerspectiveCamera();
  private orbit: Orbit;
  private readonly fly: Fly;
  private movement: MovementName = 'orbit';
  private lens: View;
  /** The test view that is shown exactly. */
  pinned: number | undefined;
  /** Whether this is the view that the model is first shown with. */
  isFirst = true;
  /** Another view that is shown exactly. */
  private exact: View | undefined;
  private turning: number | undefined;

  /** `start` is the first view; without it, it follows from the scene. */
  constructor(
    private scene: Scene,
    private sample: ModelSample,
    private readonly canvas: HTMLCanvasElement,
    private readonly events: NavigatorEvents,
    private readonly start?: AddressCamera,
  ) {
    this.camera.up.set(...scene.up).normalize();
    this.orbit = this.newOrbit();
    this.fly = new Fly(this.camera, canvas, 0.5 * Math.max(scene.distance, 1e-3), this.moved, (factor) =>
      events.faster(factor),
    );
    this.lens = this.usualLens;
    this.reset();
  }

  /** The lens of the test views, if there are any. */
  private get usualLens(): View {
    const { width, height } = DEFAULT_SIZE;
    const fy = height / 2 / Math.tan(MathUtils.degToRad(DEFAULT_FOV / 2));
    return (
      this.scene.testCameras[0] ?? {
        ...cameraPose(this.camera),
        width,
        height,
        fx: fy,
        fy,
        cx: width / 2,
        cy: height / 2,
      }
    );
  }

  private readonly moved = (): void => {
    this.stopTurning();
    this.unpin();
    this.events.changed();
  };

  private newOrbit(): Orbit {
    return new Orbit(this.camera, this.canvas, this.moved);
  }

  private get mover(): Movement {
    return this.movement === 'orbit' ? this.orbit : this.fly;
  }

  get up(): Vector {
    return vector(this.camera.up);
  }

  /** Another direction is up: the camera stands upright by that one, and a model without views shows its front. */
  setUp(up: Vector): void {
    const { target } = this;
    const { position } = this.current();
    const wasFirst = this.isFirst;
    this.mover.end();
    this.orbit.dispose();
    this.camera.up.set(...up).normalize();
    this.orbit = this.newOrbit();
    if (wasFirst || this.scene.testCameras.length === 0) this.reset();
    else this.look(position, target);
  }

  /** The test view that is shown first, if one is. */
  private get firstTestView(): number | undefined {
    const {
      start,
      scene: {
        testCameras: { length },
      },
    } = this;
    if (length === 0 || (start && 'from' in start)) return undefined;
    return start && start.view < length ? start.view : 0;
  }

  /** Whether a photograph stands upright as it is. */
  private isUpright(index: number): boolean {
    return Math.abs(rollOf(this.scene.testCameras[index], this.up)) <= MOST_ROLL;
  }

  /** The first view: the page's own, or else the first test view, or without any the model from its front. */
  reset(): void {
    const { start, firstTestView } = this;
    if (firstTestView !== undefined && this.isUpright(firstTestView)) this.pin(firstTestView);
    else if (firstTestView !== undefined) this.showUpright(this.scene.testCameras[firstTestView]);
    else {
      this.lens = this.usualLens;
      if (start && 'from' in start) this.look(start.from, start.to, start.fov);
      else this.frame(lookDown(frontOf(this.up).map((x) => -x) as Vector, this.up, DOWN));
    }
    this.isFirst = true;
  }

  /** The pose of a test view without its roll: one that lies on its side is as wide as it was high. */
  private showUpright(view: View): void {
    const roll = Math.abs(rollOf(view, this.up));
    const { width, height, fx, fy } = view;
    this.show(roll > 45 && roll < 135 ? { ...view, width: height, height: width, fx: fy, fy: fx } : view);
  }

  private show(view: View, focus?: number): void {
    const { camera } = this;
    this.mover.end(); // first: what a drag has left to do is not for this view
    this.stopTurning();
    this.unpin();
    this.lens = view;
    camera.fov = fovOf(view);
    camera.position.set(...view.position);
    camera.lookAt(new Vector3(...view.forward).add(camera.position));
    this.mover.begin(focus ?? this.focus());
  }

  /** The sphere that shows the model, as far as it is known. */
  private extent(): Extent {
    return this.sample.isEmpty ? { center: this.scene.center, radius: this.scene.distance / 2 } : this.sample.extent();
  }

  /** Distance at which the model's middle lies in the direction looked at. */
  private focus(): number {
    const { forward, position } = cameraPose(this.camera);
    const { center, radius } = this.extent();
    return Math.max(dot(minus(center, position), forward), 0.1 * radius, 1e-3);
  }

  /** More of the model is known. */
  learn(): void {
    if (this.isFirst) this.reset();
    else if (this.pinned !== undefined) this.pin(this.pinned);
  }

  /** Goes on with a newer state of the model, from where the camera is. */
  setScene(scene: Scene, sample: ModelSample): void {
    this.scene = scene;
    this.sample = sample;
    if (this.pinned !== undefined && this.pinned >= scene.testCameras.length) this.unpin();
  }

  pin(index: number): void {
    this.show(this.scene.testCameras[index]);
    this.pinned = index;
    this.isFirst = index === this.firstTestView && this.isUpright(index);
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
    const offset = new Vector3(...to).sub(new Vector3(...from));
    const distance = offset.length();
    this.show({ ...withFov(this.lens, fov), position: from, forward: vector(offset.divideScalar(distance)) }, distance);
  }

  /**
   * Goes back until all of the model is seen, in the direction looked at or another one. Where something else stands in
   * front of it, as the walls of a room, it looks from higher above.
   */
  frame(direction = this.current().forward): void {
    const { center, radius } = this.extent();
    const { lens } = this;
    const half = Math.atan(Math.min(lens.width / 2 / lens.fx, lens.height / 2 / lens.fy));
    const distance = (MARGIN * Math.max(radius, 1e-3)) / Math.sin(half);
    const down = MathUtils.radToDeg(Math.asin(MathUtils.clamp(-dot(direction, this.up), -1, 1)));
    const from = (forward: Vector) => center.map((c, i) => c - distance * forward[i]) as Vector;
    let best = { forward: direction, covered: Infinity };
    for (const forward of [
      direction,
      ...STEEPER.filter((angle) => angle > down).map((angle) => lookDown(direction, this.up, angle)),
    ]) {
      this.look(from(forward), center);
      const covered = this.sample.covered(this.current(), distance - radius);
      if (covered < best.covered) best = { forward, covered };
      if (covered <= MOST_COVERED) return;
    }
    this.look(from(best.forward), center);
  }

  /** Turns to a point, which the camera moves around from then on. */
  turnTo(point: Vector): void {
    const { position } = this.current();
    const from = this.target;
    const start = performance.now();
    const still = matchMedia('(prefers-reduced-motion: reduce)').matches;
    const step = () => {
      const t = still ? 1 : Math.min(1, (performance.now() - start) / TURN);
      const s = t * t * (3 - 2 * t);
      this.look(position, from.map((x, i) => x + s * (point[i] - x)) as Vector);
      if (t < 1) this.turning = requestAnimationFrame(step);
      this.events.changed();
    };
    step();
  }

  private stopTurning(): void {
    if (this.turning !== undefined) cancelAnimationFrame(this.turning);
    this.turning = undefined;
  }

  /** The point that is looked at. */
  get target(): Vector {
    if (this.movement === 'orbit') return vector(this.orbit.target);
    const { forward, position } = cameraPose(this.camera);
    const focus = this.focus();
    return position.map((p, i) => p + focus * forward[i]) as Vector;
  }

  get fov(): number {
    return fovOf(this.lens);
  }

  setMovement(name: MovementName): void {
    this.stopTurning();
    this.mover.end();
    this.movement = name;
    this.mover.begin(this.focus());
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
    this.stopTurning();
    this.fly.end();
    this.orbit.dispose();
  }
}
