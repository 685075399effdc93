// SPDX-License-Identifier: Apache-2.0
// The canvas, and what draws on it: WebGPU where there is a device, as long as that can, and WebGL2 otherwise.

import type { Scene } from './format/ngsplat';
import { Renderer } from './render/renderer';
import type { SceneRenderer } from './render/scene_renderer';
import { element } from './ui/elements';
import { WebGpuRenderer } from './webgpu/renderer';

/** More pixels than this per CSS pixel are not seen, but paid for. */
const MOST_DEVICE_PIXELS = 2;

/** What a screen tells the page. */
export interface ScreenEvents {
  /** The size was set, which has cleared the picture. */
  resized(): void;
  /** WebGPU cannot go on; `message` says why. */
  failed(message: string): void;
  /** `renderer.drawn` is that of the last picture. */
  counted(): void;
}

export class Screen {
  /** What the user points at, and where WebGL2 draws. */
  readonly canvas = element<HTMLCanvasElement>('canvas');
  renderer: SceneRenderer;

  /** Throws RenderError where nothing can draw. */
  constructor(
    device: GPUDevice | undefined,
    private readonly events: ScreenEvents,
  ) {
    this.renderer = device
      ? new WebGpuRenderer(
          device,
          this.canvasBehind(),
          (message) => events.failed(message),
          () => events.counted(),
        )
      : new Renderer(this.canvas);
    new ResizeObserver(this.resize).observe(this.canvas);
    addEventListener('resize', this.resize); // another density of the screen may become known after the size
    this.watchDensity();
  }

  /** A window that moves to a screen of another density may keep its size in CSS pixels: no observer of sizes fires. */
  private watchDensity(): void {
    matchMedia(`(resolution: ${devicePixelRatio}dppx)`).addEventListener(
      'change',
      () => {
        this.watchDensity();
        this.resize();
      },
      { once: true },
    );
  }

  /** A canvas for WebGPU: one that has drawn by one way cannot draw by the other. */
  private canvasBehind(): HTMLCanvasElement {
    const canvas = document.createElement('canvas');
    canvas.id = 'webgpu-canvas';
    canvas.ariaHidden = 'true';
    this.canvas.before(canvas);
    return canvas;
  }

  private readonly resize = () => {
    const scale = Math.min(devicePixelRatio, MOST_DEVICE_PIXELS);
    this.renderer.setSize(
      Math.max(1, Math.round(scale * this.canvas.clientWidth)),
      Math.max(1, Math.round(scale * this.canvas.clientHeight)),
    );
    this.events.resized();
  };

  /** From here on WebGL2 draws. There must be no scene. */
  useWebGl(): void {
    this.renderer.forget();
    this.renderer.canvas.remove();
    this.renderer = new Renderer(this.canvas);
    this.resize();
  }

  /**
   * Gives the scene to what draws it: to WebGL2 where WebGPU does not take it. Throws RenderError where the device
   * cannot hold it.
   */
  beginScene(scene: Scene): void {
    if (!this.renderer.canvas.isConnected) this.useWebGl(); // which could not be done before
    try {
      this.renderer.beginScene(scene);
    } catch (error) {
      if (this.renderer instanceof Renderer) throw error;
      console.info(`WebGL2 draws from here on: ${(error as Error).message}`);
      this.useWebGl();
      this.renderer.beginScene(scene);
    }
  }
}
