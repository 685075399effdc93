// SPDX-License-Identifier: Apache-2.0
/// <reference types="webxr" />
// The model in a headset, where the browser has one: a picture for each eye by WebGL2, and sticks to move by.

import { Quaternion, Vector3, WebGLRenderTarget, type WebGLRenderer } from 'three';
import type { View } from '../camera/view';
import type { Vector } from '../format/vector';
import type { Renderer } from '../render/renderer';
import type { Picture } from '../render/scene_renderer';
import { element } from '../ui/elements';
import { eyeView, headView, placeAt, pointIn, UP, type Head, type Place } from './eyes';

/** Parts of the page that the headset uses. */
export interface WornPage {
  /** Leaves WebGPU, which draws for no headset. */
  webGl(): Renderer;
  /** The renderer and the page's camera; undefined while no model is there. */
  model(): { picture: Picture; position: Vector; target: Vector; up: Vector } | undefined;
  /** Brings the order of the Gaussians up to date. */
  sort(view: View): void;
  /** The page itself is looked at again. */
  ended(): void;
  fail(title: string, message: string): void;
}

const MODE = 'immersive-vr';
/** Metres a second by a stick, degrees of a turn, how fast sizes change, and from where on a stick counts. */
const SPEED = 2;
const TURN = 30;
const GROWTH = 1;
const DEAD = 0.15;
const PUSHED = 0.7;

/** A method of three.js that its types leave out: a target stands for a framebuffer, null for the canvas. */
type ForeignTargets = WebGLRenderer & {
  setRenderTargetFramebuffer(target: WebGLRenderTarget, framebuffer: WebGLFramebuffer | null): void;
};

const button = element<HTMLButtonElement>('enter-vr');

export class Headset {
  private session: XRSession | undefined;
  private space: XRReferenceSpace | undefined;
  private place: Place | undefined;
  private target: WebGLRenderTarget | undefined;
  private lastTime = 0;
  private hasTurned = false;

  constructor(private readonly page: WornPage) {
    button.addEventListener('click', () => void this.enter());
    navigator.xr?.addEventListener('devicechange', () => void this.look());
    void this.look();
  }

  /** The button is there where a headset is. */
  private async look(): Promise<void> {
    const isThere = await navigator.xr?.isSessionSupported(MODE).catch(() => false);
    button.hidden = !isThere;
  }

  /** While the headset is worn, the page itself is not drawn. */
  get isOn(): boolean {
    return this.session !== undefined;
  }

  private async enter(): Promise<void> {
    if (this.session) return void this.session.end();
    try {
      const session = await navigator.xr!.requestSession(MODE); // first: only a click may ask for it
      try {
        await this.begin(session);
      } catch (error) {
        await session.end();
        throw error;
      }
    } catch (error) {
      this.page.fail('VR cannot start', (error as Error).message);
    }
  }

  private async begin(session: XRSession): Promise<void> {
    const { webgl } = this.page.webGl();
    const gl = webgl.getContext() as WebGL2RenderingContext;
    await gl.makeXRCompatible();
    const layer = new XRWebGLLayer(session, gl, { alpha: false, antialias: false, depth: false });
    await session.updateRenderState({ baseLayer: layer });
    this.space = await session.requestReferenceSpace('local');
    this.target = new WebGLRenderTarget(layer.framebufferWidth, layer.framebufferHeight, { depthBuffer: false });
    this.session = session;
    this.place = undefined;
    this.lastTime = 0;
    button.textContent = 'Leave VR';
    session.addEventListener('end', () => this.end());
    session.requestAnimationFrame(this.draw);
  }

  private end(): void {
    this.session = this.space = this.target = undefined;
    button.textContent = 'Enter VR';
    this.page.ended();
  }

  private readonly draw = (time: number, frame: XRFrame): void => {
    const { session, space, target } = this;
    if (!session || !space || !target) return;
    session.requestAnimationFrame(this.draw);
    const model = this.page.model();
    const pose = frame.getViewerPose(space);
    const layer = session.renderState.baseLayer;
    if (!model || !pose || !layer) return;
    const { position: p, orientation: q } = pose.transform;
    const head = { position: new Vector3(p.x, p.y, p.z), orientation: new Quaternion(q.x, q.y, q.z, q.w) };
    this.place ??= placeAt(model.position, model.target, model.up, head);
    this.move(this.place, session, head, this.lastTime ? Math.min(0.1, (time - this.lastTime) / 1000) : 0);
    this.lastTime = time;
    const eyes = pose.views.map((eye) => ({ eye, port: layer.getViewport(eye)! }));
    const views = eyes.map(({ eye, port }) =>
      eyeView(this.place!, eye.transform.matrix, eye.projectionMatrix, port.width, port.height),
    );
    this.page.sort(headView(views));
    const renderer = this.page.webGl();
    (renderer.webgl as ForeignTargets).setRenderTargetFramebuffer(target, layer.framebuffer);
    eyes.forEach(({ port: { x, y, width, height } }, k) => {
      target.viewport.set(x, y, width, height);
      target.scissor.set(x, y, width, height);
      renderer.render(views[k], model.picture, target);
    });
  };

  /** The left stick moves where one looks; the right one turns, and makes the model larger or smaller. */
  private move(place: Place, { inputSources }: XRSession, head: Head, seconds: number): void {
    for (const { handedness, gamepad } of inputSources ?? []) {
      const [x, y] = [2, 3].map((k) => gamepad?.axes[k] ?? 0).map((value) => (Math.abs(value) < DEAD ? 0 : value));
      if (handedness !== 'right') {
        const ahead = new Vector3(0, 0, -1).applyQuaternion(head.orientation).setY(0).normalize();
        const step = ahead
          .clone()
          .multiplyScalar(-y)
          .addScaledVector(ahead.cross(UP), x)
          .multiplyScalar(SPEED * seconds);
        place.position.copy(pointIn(place, step));
        continue;
      }
      const before = pointIn(place, head.position);
      if (Math.abs(x) < PUSHED) this.hasTurned = false;
      else if (!this.hasTurned) {
        place.rotation.multiply(new Quaternion().setFromAxisAngle(UP, (-Math.sign(x) * TURN * Math.PI) / 180));
        this.hasTurned = true;
      }
      if (Math.abs(x) < PUSHED) place.scale *= Math.exp(GROWTH * y * seconds); // pushed away, the model grows
      place.position.add(before.sub(pointIn(place, head.position))); // the head stays where it is
    }
  }
}
