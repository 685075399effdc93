// SPDX-License-Identifier: Apache-2.0
// From a file and a view to a picture by WebGL2: colours of all Gaussians (prepass), blending back to front (splats),
// background and photometric correction (resolve).

import { WebGLRenderer, type WebGLRenderTarget } from 'three';
import type { View } from '../camera/view';
import type { Scene } from '../format/ngsplat';
import type { Plane } from '../format/reader';
import { GpuScene } from './gpu_scene';
import { fullscreenPass, uniforms } from './pass';
import { correction } from './photometric';
import { Prepass, type Mode } from './prepass';
import resolveCode from './resolve.frag.glsl?raw';
import pixelCode from './resolve.glsl?raw';
import { RenderError, type Picture, type SceneRenderer } from './scene_renderer';
import { PLAIN_SPLATS, Splats } from './splats';
import { renderTarget, targetBytes, type Precision } from './target';

/** Equal where the colours of all Gaussians are. */
function colorsKey(view: View, mode: Mode, precision: Precision): string {
  return JSON.stringify([view.position, view.forward, mode, precision]);
}

export class Renderer implements SceneRenderer {
  readonly way = 'WebGL2';
  readonly sortsItself = false;
  readonly benchmarkProtocol =
    'frame = colours of all Gaussians + blending into RGBA8 at 1280x720, native intrinsics, near plane 0.2, one pixel read after each; one untimed frame a view, sorting and photometric correction excluded';
  readonly webgl: WebGLRenderer;
  private readonly gl: WebGL2RenderingContext;
  private readonly blended: Record<Precision, WebGLRenderTarget>;
  private readonly resolve = fullscreenPass(
    resolveCode + pixelCode,
    uniforms({
      blended: null,
      origin: [0, 0],
      background: [0, 0, 0],
      corrected: false,
      gain: 1,
      mix_colors: [1, 0, 0, 0, 1, 0, 0, 0, 1],
      response: new Float32Array(18),
    }),
  );
  private gpu: GpuScene | undefined;
  private prepass: Prepass | undefined;
  private splats: Splats | undefined;
  private colorsOf = '';

  /**
   * On a canvas, or on the device of another renderer, for a scene of its own. Throws RenderError where there is no
   * WebGL2.
   */
  constructor(canvas: HTMLCanvasElement | Renderer) {
    if (canvas instanceof Renderer) {
      ({ webgl: this.webgl, gl: this.gl, blended: this.blended } = canvas);
      return;
    }
    const context = canvas.getContext('webgl2', {
      antialias: false,
      alpha: false,
      depth: false,
      powerPreference: 'high-performance',
    });
    if (!context)
      throw new RenderError('This page needs WebGL2, which this browser does not offer or has switched off.');
    this.gl = context;
    this.webgl = new WebGLRenderer({ canvas, context });
    this.webgl.autoClear = false;
    this.webgl.debug.onShaderError = (gl, _program, vertex, fragment) => {
      const log = [vertex, fragment]
        .map((shader) => gl.getShaderInfoLog(shader))
        .filter(Boolean)
        .join('\n');
      throw new RenderError(`The graphics driver rejects a shader.\n${log}`);
    };
    this.blended = { half: renderTarget('half'), byte: renderTarget('byte') };
  }

  get canvas(): HTMLCanvasElement {
    return this.webgl.domElement;
  }

  get precision(): Precision {
    return this.gl.getExtension('EXT_color_buffer_float') || this.gl.getExtension('EXT_color_buffer_half_float')
      ? 'half'
      : 'byte';
  }

  setSize(width: number, height: number): void {
    this.webgl.setSize(width, height, false);
  }

  beginScene(scene: Scene): void {
    this.clearScene();
    const largest = this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE) as number;
    if (scene.textureHeight > largest)
      throw new RenderError(
        `This device holds textures of ${largest} rows, enough for ${2048 * largest} Gaussians; the file has ${scene.count}.`,
      );
    if (scene.count === 0) return;
    while (this.gl.getError() !== this.gl.NO_ERROR); // of what came before
    this.gpu = new GpuScene(scene);
    this.prepass = new Prepass(this.gpu);
    this.splats = new Splats(this.gpu);
    try {
      this.gpu.allocate(this.webgl);
      this.webgl.initRenderTarget(this.prepass.target(this.precision));
      if (this.gl.getError() === this.gl.OUT_OF_MEMORY)
        throw new RenderError('The graphics memory does not suffice for this file.');
    } catch (error) {
      this.clearScene();
      throw error;
    }
  }

  addRows(plane: Plane, row: number, texels: Uint32Array): void {
    this.gpu!.write(this.webgl, plane, row, texels);
    if (plane.block < 0) this.colorsOf = '';
  }

  completeScene(): void {
    this.prepass?.complete();
    this.colorsOf = '';
  }

  clearScene(): void {
    for (const part of [this.gpu, this.prepass, this.splats]) part?.dispose();
    this.gpu = this.prepass = this.splats = undefined;
    this.colorsOf = '';
  }

  /** What comes next is made anew. */
  forget(): void {
    this.clearScene();
    for (const target of Object.values(this.blended)) target.dispose();
    this.resolve.dispose();
  }

  setOrder(order: Uint32Array, count: number): Uint32Array {
    return this.splats!.setOrder(order, count);
  }

  order(): Promise<Uint32Array> {
    return Promise.resolve(this.splats?.order ?? new Uint32Array());
  }

  get drawn(): number {
    return this.splats?.count ?? 0;
  }

  get bytes(): number {
    return this.gpu ? this.gpu.bytes + targetBytes(this.prepass!.target(this.precision)) + 4 * this.gpu.scene.count : 0;
  }

  /** Colours of all Gaussians for this view. */
  private drawColors(view: View, mode: Mode, precision: Precision): void {
    this.colorsOf = colorsKey(view, mode, precision);
    this.prepass?.draw(this.webgl, view, mode, precision);
  }

  /** Blends the Gaussians with the colours of the last drawColors. */
  private drawSplats(view: View, precision: Precision, style = PLAIN_SPLATS): WebGLRenderTarget {
    const target = this.blended[precision];
    if (target.width !== view.width || target.height !== view.height) target.setSize(view.width, view.height);
    this.webgl.setRenderTarget(target);
    this.webgl.setClearColor(0, 0);
    this.webgl.clear(true, false, false);
    if (this.gpu) this.splats!.draw(this.webgl, view, style, this.prepass!.target(precision).texture, target);
    return target;
  }

  /** The whole way, to the screen or to the viewport of `target`. */
  render(view: View, picture: Picture, target: WebGLRenderTarget | null = null, precision = this.precision): void {
    if (this.colorsOf !== colorsKey(view, picture.mode, precision)) this.drawColors(view, picture.mode, precision);
    const blended = this.drawSplats(view, precision, picture.splats);
    const origin = target ? [target.viewport.x, target.viewport.y] : [0, 0];
    this.resolve.set({
      blended: blended.texture,
      origin,
      background: picture.background,
      ...correction(picture.exposure, this.gpu?.scene.photometric?.response),
    });
    this.resolve.draw(this.webgl, target);
  }

  /** What `draw` draws on the canvas stays within the columns from `first` to before `end`. */
  within(first: number, end: number, height: number, draw: () => void): void {
    const targets = Object.values(this.blended);
    for (const target of targets) {
      target.scissor.set(first, 0, end - first, height); // saves work: the rest would not be seen
      target.scissorTest = true;
    }
    this.webgl.setScissor(first, 0, end - first, height);
    this.webgl.setScissorTest(true);
    try {
      draw();
    } finally {
      for (const target of targets) target.scissorTest = false;
      this.webgl.setScissorTest(false);
    }
  }

  async renderPixels(view: View, picture: Picture, precision = this.precision): Promise<Uint8Array> {
    const { width, height } = view;
    const target = renderTarget('byte', width, height);
    const rows = new Uint8Array(4 * width * height);
    const out = new Uint8Array(rows.length);
    this.render(view, picture, target, precision);
    this.webgl.readRenderTargetPixels(target, 0, 0, width, height, rows);
    target.dispose();
    for (let y = 0; y < height; ++y)
      out.set(rows.subarray(4 * width * (height - 1 - y), 4 * width * (height - y)), 4 * width * y);
    return out;
  }

  /** Waits until what was drawn into `target` is there, by reading a pixel. */
  private finish(target: WebGLRenderTarget): void {
    this.webgl.readRenderTargetPixels(target, 0, 0, 1, 1, new Uint8Array(4));
  }

  async timeColors(view: View): Promise<void> {
    this.drawColors(view, 'full', 'byte');
    if (this.prepass) this.finish(this.prepass.target('byte'));
  }

  async timeFrame(view: View): Promise<void> {
    this.drawColors(view, 'full', 'byte');
    this.finish(this.drawSplats(view, 'byte'));
  }

  get deviceName(): string {
    const info = this.gl.getExtension('WEBGL_debug_renderer_info');
    return this.gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : this.gl.RENDERER) as string;
  }
}
