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

/** Drag or arrow keys turn around the point looked at, the wheel, two fingers or + and - come closer, with the right button or shift it moves along. */
export class Orbit implements Movement {
  private readonly controls: OrbitControls;
  private silent = false;

  constructor(private readonly camera: PerspectiveCamera, private readonly canvas: HTMLCanvasElement, changed: () => void) {
    this.controls = new OrbitControls(camera, canvas); // takes the camera's up at this moment
    this.controls.addEventListener('change', () => {
      if (!this.silent) changed();
    });
    this.controls.enabled = false;
  }

  begin(focus: number): void {
    this.canvas.addEventListener('keydown', this.onKey);
    this.controls.target.copy(this.camera.position).addScaledVector(this.camera.getWorldDirection(new Vector3()), focus);
    this.controls.enabled = true;
    this.silent = true;
    this.controls.update();
    this.silent = false;
  }

  /** The point that the camera turns around. */
  get target(): Vector3 {
    return this.controls.target;
  }

  end(): void {
    this.canvas.removeEventListener('keydown', this.onKey);
    this.controls.enabled = false;
  }

  dispose(): void {
    this.end();
    this.controls.dispose();
  }

  private onKey = (event: KeyboardEvent): void => {
    const { controls } = this;
    const [x, y] = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [0, 0];
    if (event.key === '+' || event.key === '=') controls.dollyIn(1 / 0.95);
    else if (event.key === '-') controls.dollyOut(1 / 0.95);
    else if (x === 0 && y === 0) return;
    else if (event.shiftKey) controls.pan(20 * x, 20 * y);
    else {
      controls.rotateLeft(STEP * x);
      controls.rotateUp(STEP * y);
    }
    event.preventDefault();
    controls.update();
  };
}

/** Drag looks around; W A S D, E and Q move, arrow keys look. Two fingers move: up is forward. */
export class Fly implements Movement {
  private readonly keys = new Set<string>();
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private lastTime = 0;

  /** `speed` in world units per second. */
  constructor(private readonly camera: PerspectiveCamera, private readonly canvas: HTMLCanvasElement, private readonly speed: number, private readonly changed: () => void) {}

  private readonly listeners: [string, (event: never) => void][] = [
    ['keydown', (event: KeyboardEvent) => this.onKey(event, true)],
    ['keyup', (event: KeyboardEvent) => this.onKey(event, false)],
    ['blur', () => this.keys.clear()],
    ['pointerdown', (event: PointerEvent) => this.onPointerDown(event)],
    ['pointermove', (event: PointerEvent) => this.onPointerMove(event)],
    ['pointerup', (event: PointerEvent) => this.pointers.delete(event.pointerId)],
    ['pointercancel', (event: PointerEvent) => this.pointers.delete(event.pointerId)],
  ];

  begin(): void {
    for (const [name, listener] of this.listeners) this.canvas.addEventListener(name, listener as EventListener);
  }

  end(): void {
    for (const [name, listener] of this.listeners) this.canvas.removeEventListener(name, listener as EventListener);
    this.keys.clear();
    this.pointers.clear();
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
    const wasIdle = this.keys.size === 0;
    this.keys.add(key);
    if (!wasIdle) return;
    this.lastTime = performance.now();
    requestAnimationFrame(this.tick);
  }

  private tick = (): void => {
    if (this.keys.size === 0) return;
    const now = performance.now(), seconds = Math.min(0.1, (now - this.lastTime) / 1000);
    this.lastTime = now;
    const axis = (minus: string, plus: string) => Number(this.keys.has(plus)) - Number(this.keys.has(minus));
    this.move(axis('a', 'd') * seconds, axis('q', 'e') * seconds, axis('s', 'w') * seconds);
    this.look(axis('arrowright', 'arrowleft') * seconds, axis('arrowdown', 'arrowup') * seconds);
    this.changed();
    requestAnimationFrame(this.tick);
  };

  /** Right, up and forward, in seconds at full speed. */
  private move(right: number, up: number, forward: number): void {
    this.camera.position.add(new Vector3(right, up, -forward).multiplyScalar(this.speed).applyQuaternion(this.camera.quaternion));
  }

  /** By angles to the left and upwards; keeps the horizon level and stops before it turns over. */
  private look(left: number, up: number): void {
    const { camera } = this, direction = camera.getWorldDirection(new Vector3()).applyAxisAngle(camera.up, left);
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
    const dx = (event.clientX - last.x) / this.canvas.clientHeight, dy = (event.clientY - last.y) / this.canvas.clientHeight;
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size === 1) this.look(2 * dx, 2 * dy);
    else this.move(dx, 0, -2 * dy);
    this.changed();
  }
}
