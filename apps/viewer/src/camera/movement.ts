// SPDX-License-Identifier: Apache-2.0
// Two ways to move a camera: around a point (three.js OrbitControls, with keys), and through the scene.

import { MathUtils, Vector3, type PerspectiveCamera } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

export interface Movement {
  /** Takes over from wherever the camera is; `focus` is the distance of what is looked at. */
  begin(focus: number): void;
  end(): void;
}

const STEP = MathUtils.degToRad(3);
/** Factor on the distance for a key, and on the speed for a notch of the wheel of so many pixels. */
const NEARER = 0.95;
const FASTER = 1.25;
const NOTCH = 100;
const LEAST_SPEED = 1 / 64;
const MOST_SPEED = 64;

/** Seconds in which what a drag left to do shrinks to 1/e, and after how many there is nothing of it. */
const GLIDE = 0.12;
const REST = 8 * GLIDE;

/** The share of what a drag left to do that so many seconds do: all at once for those who asked for less motion. */
const glide = (seconds: number): number =>
  matchMedia('(prefers-reduced-motion: reduce)').matches ? 1 : 1 - Math.exp(-seconds / GLIDE);

/**
 * Drag or arrow keys turn around the point looked at, the wheel, two fingers or + and - come closer, with the right
 * button or shift it moves along.
 */
export class Orbit implements Movement {
  private readonly controls: OrbitControls;
  private silent = false;
  private isHeld = false;
  private lastTime = 0;
  /** When there is nothing left to do; undefined while nothing moves. */
  private restsAt: number | undefined;

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly canvas: HTMLCanvasElement,
    changed: () => void,
  ) {
    this.controls = new OrbitControls(camera, canvas); // takes the camera's up at this moment
    this.controls.enableDamping = true;
    this.controls.addEventListener('change', () => {
      if (!this.silent) changed();
    });
    this.controls.addEventListener('start', () => {
      this.isHeld = true;
      this.wake();
    });
    this.controls.addEventListener('end', () => {
      this.isHeld = false;
      this.wake();
    });
    this.controls.enabled = false;
  }

  begin(focus: number): void {
    this.canvas.addEventListener('keydown', this.onKey);
    this.controls.target
      .copy(this.camera.position)
      .addScaledVector(this.camera.getWorldDirection(new Vector3()), focus);
    this.controls.enabled = true;
    this.settle();
  }

  /** The point that the camera turns around. */
  get target(): Vector3 {
    return this.controls.target;
  }

  end(): void {
    this.canvas.removeEventListener('keydown', this.onKey);
    this.settle(); // what was left to do is not for the next view
    this.controls.enabled = false;
    this.restsAt = undefined;
  }

  dispose(): void {
    this.end();
    this.controls.dispose();
  }

  /** Does at once what is left to do. */
  private settle(): void {
    this.silent = true;
    this.controls.dampingFactor = 1;
    this.controls.update();
    this.silent = false;
  }

  /** Something moves the camera from here on. */
  private wake(): void {
    const now = performance.now();
    const wasIdle = this.restsAt === undefined;
    this.restsAt = now + 1000 * REST;
    if (!wasIdle) return;
    this.lastTime = now;
    this.controls.dampingFactor = glide(1 / 60);
    requestAnimationFrame(this.tick);
  }

  private readonly tick = (): void => {
    if (this.restsAt === undefined) return;
    const now = performance.now();
    const isOver = !this.isHeld && now >= this.restsAt;
    this.controls.dampingFactor = isOver ? 1 : glide((now - this.lastTime) / 1000);
    this.lastTime = now;
    this.controls.update();
    if (isOver) this.restsAt = undefined;
    else requestAnimationFrame(this.tick);
  };

  private onKey = (event: KeyboardEvent): void => {
    const { controls } = this;
    const [x, y] = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [0, 0];
    if (event.key === '+' || event.key === '=') controls.dollyIn(NEARER);
    else if (event.key === '-') controls.dollyOut(NEARER);
    else if (x === 0 && y === 0) return;
    else if (event.shiftKey) controls.pan(20 * x, 20 * y);
    else {
      controls.rotateLeft(STEP * x);
      controls.rotateUp(STEP * y);
    }
    event.preventDefault();
    this.wake();
    controls.update();
  };
}

/**
 * Drag looks around; W A S D, E and Q move, arrow keys look, the wheel changes the speed. Two fingers move: up is
 * forward.
 */
export class Fly implements Movement {
  private readonly keys = new Set<string>();
  private readonly pointers = new Map<number, { x: number; y: number }>();
  /**
   * Motion that drags have left over: angles to the left and upwards, seconds at full speed to the right and forward.
   */
  private readonly rest = { left: 0, up: 0, right: 0, forward: 0 };
  private lastTime = 0;
  private isMoving = false;
  /** A factor of the speed. */
  private factor = 1;

  /** `speed` in world units per second; `faster` is told a new factor of it. */
  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly canvas: HTMLCanvasElement,
    private readonly speed: number,
    private readonly changed: () => void,
    private readonly faster: (factor: number) => void,
  ) {}

  private readonly listeners: [string, (event: never) => void][] = [
    ['keydown', (event: KeyboardEvent) => this.onKey(event, true)],
    ['keyup', (event: KeyboardEvent) => this.onKey(event, false)],
    ['blur', () => this.keys.clear()],
    ['pointerdown', (event: PointerEvent) => this.onPointerDown(event)],
    ['pointermove', (event: PointerEvent) => this.onPointerMove(event)],
    ['pointerup', (event: PointerEvent) => this.pointers.delete(event.pointerId)],
    ['pointercancel', (event: PointerEvent) => this.pointers.delete(event.pointerId)],
    ['wheel', (event: WheelEvent) => this.onWheel(event)],
  ];

  begin(): void {
    for (const [name, listener] of this.listeners) this.canvas.addEventListener(name, listener as EventListener);
  }

  end(): void {
    for (const [name, listener] of this.listeners) this.canvas.removeEventListener(name, listener as EventListener);
    this.keys.clear();
    this.pointers.clear();
    Object.assign(this.rest, { left: 0, up: 0, right: 0, forward: 0 });
  }

  private onKey(event: KeyboardEvent, down: boolean): void {
    const known = ['w', 'a', 's', 'd', 'q', 'e', 'arrowleft', 'arrowright', 'arrowup', 'arrowdown'];
    const key = event.key.toLowerCase();
    if (!known.includes(key) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    if (!down) {
      this.keys.delete(key);
      return;
    }
    this.keys.add(key);
    this.wake();
  }

  private wake(): void {
    if (this.isMoving) return;
    this.isMoving = true;
    this.lastTime = performance.now();
    requestAnimationFrame(this.tick);
  }

  private readonly tick = (): void => {
    const { keys, rest } = this;
    this.isMoving = keys.size > 0 || Object.values(rest).some((value) => Math.abs(value) > 1e-4);
    if (!this.isMoving) return;
    const now = performance.now();
    const seconds = Math.min(0.1, (now - this.lastTime) / 1000);
    const share = glide((now - this.lastTime) / 1000);
    this.lastTime = now;
    const axis = (minus: string, plus: string) => Number(keys.has(plus)) - Number(keys.has(minus));
    this.move(
      axis('a', 'd') * seconds + share * rest.right,
      axis('q', 'e') * seconds,
      axis('s', 'w') * seconds + share * rest.forward,
    );
    this.look(
      axis('arrowright', 'arrowleft') * seconds + share * rest.left,
      axis('arrowdown', 'arrowup') * seconds + share * rest.up,
    );
    for (const name of ['left', 'up', 'right', 'forward'] as const) rest[name] *= 1 - share;
    this.changed();
    requestAnimationFrame(this.tick);
  };

  /** Right, up and forward, in seconds at full speed. */
  private move(right: number, up: number, forward: number): void {
    this.camera.position.add(
      new Vector3(right, up, -forward).multiplyScalar(this.factor * this.speed).applyQuaternion(this.camera.quaternion),
    );
  }

  /** By angles to the left and upwards; keeps the horizon level and stops before it turns over. */
  private look(left: number, up: number): void {
    const { camera } = this;
    const direction = camera.getWorldDirection(new Vector3()).applyAxisAngle(camera.up, left);
    const elevation = Math.PI / 2 - direction.angleTo(camera.up);
    const bounded = MathUtils.clamp(elevation + up, -1.5, 1.5) - elevation;
    const axis = new Vector3().crossVectors(direction, camera.up).normalize();
    camera.lookAt(direction.applyAxisAngle(axis, bounded).add(camera.position));
  }

  private onPointerDown(event: PointerEvent): void {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  private onPointerMove(event: PointerEvent): void {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const dx = (event.clientX - last.x) / this.canvas.clientHeight;
    const dy = (event.clientY - last.y) / this.canvas.clientHeight;
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size === 1) {
      this.rest.left += 2 * dx;
      this.rest.up += 2 * dy;
    } else {
      this.rest.right += dx;
      this.rest.forward -= 2 * dy;
    }
    this.wake();
    this.changed();
  }

  private onWheel(event: WheelEvent): void {
    event.preventDefault();
    const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? NOTCH * Math.sign(event.deltaY) : event.deltaY;
    const notches = MathUtils.clamp(pixels / NOTCH, -1, 1); // a touchpad sends many small parts
    this.factor = MathUtils.clamp(this.factor * FASTER ** -notches, LEAST_SPEED, MOST_SPEED);
    this.faster(this.factor);
  }
}
