// SPDX-License-Identifier: Apache-2.0
// From a file and a view to a picture by WebGPU: what is in the view, by depth; its colours; blending back to front;
// background and photometric correction. All of it happens on the device, for every picture anew.

import type { View } from '../camera/view';
import type { Scene } from '../format/ngsplat';
import type { Plane } from '../format/reader';
import type { Mode } from '../render/prepass';
import { RenderError, type Picture, type SceneRenderer } from '../render/scene_renderer';
import { PLAIN_SPLATS, type SplatStyle } from '../render/splats';
import type { Precision } from '../render/target';
import { ColorPass } from './color_pass';
import { DepthOrder } from './depth_order';
import { ResolvePass } from './resolve_pass';
import { SceneBuffers } from './scene_buffers';
import { SplatPass } from './splat_pass';
import { readPixels, readWords, target, TARGET_FORMATS } from './targets';

interface Parts {
  buffers: SceneBuffers;
  order: DepthOrder;
  colors: ColorPass;
  splats: SplatPass;
}

export class WebGpuRenderer implements SceneRenderer {
  readonly way = 'WebGPU';
  readonly sortsItself = true;
  readonly precision = 'half';
  readonly benchmarkProtocol =
    'frame = culling, sorting and colours of the Gaussians in the view + blending into RGBA8 at 1280x720, native intrinsics, near plane 0.2, the queue waited for after each; one untimed frame a view, photometric correction excluded';
  drawn = 0;
  private readonly context: GPUCanvasContext;
  private readonly resolve: ResolvePass;
  private readonly blended: Partial<Record<Precision, GPUTexture>> = {};
  private parts: Parts | undefined;
  private isCounting = false;
  private isUncounted = false;
  private isForgotten = false;

  /**
   * `failed` is called with a message where the device is lost or refuses something, `counted` when `drawn` is that of
   * the last picture.
   */
  constructor(
    private readonly device: GPUDevice,
    readonly canvas: HTMLCanvasElement,
    failed: (message: string) => void,
    private readonly counted: () => void,
  ) {
    const context = canvas.getContext('webgpu');
    if (!context) throw new RenderError('This canvas does not take WebGPU.');
    this.context = context;
    context.configure({
      device,
      format: TARGET_FORMATS.byte,
      usage: GPUTextureUsage.RENDER_ATTACHMENT,
      alphaMode: 'opaque',
    });
    this.resolve = new ResolvePass(device);
    const fail = (message: string) => {
      if (!this.isForgotten) failed(message);
    };
    device.addEventListener('uncapturederror', ({ error }) => fail(error.message));
    void device.lost.then(({ message }) => fail(message));
  }

  get deviceName(): string {
    // older browsers have none
    const { vendor, architecture, description } = (this.device.adapterInfo as GPUAdapterInfo | undefined) ?? {};
    return [vendor, architecture, description].filter(Boolean).join(' ') || 'an unnamed device';
  }

  setSize(width: number, height: number): void {
    this.canvas.width = width;
    this.canvas.height = height;
  }

  beginScene(scene: Scene): void {
    this.clearScene();
    if (scene.count === 0) return;
    const buffers = new SceneBuffers(this.device, scene);
    const order = new DepthOrder(this.device, buffers.geometry, scene.count);
    const colors = new ColorPass(this.device, buffers, order);
    this.parts = { buffers, order, colors, splats: new SplatPass(this.device, buffers, order, colors) };
  }

  addRows(plane: Plane, row: number, texels: Uint32Array): void {
    this.parts!.buffers.write(plane, row, texels);
  }

  completeScene(): void {
    this.parts?.colors.complete();
  }

  clearScene(): void {
    for (const part of Object.values(this.parts ?? {}) as { dispose(): void }[]) part.dispose();
    this.parts = undefined;
    this.drawn = 0;
  }

  forget(): void {
    this.isForgotten = true;
    this.clearScene();
    this.device.destroy();
  }

  setOrder(): never {
    throw new Error('The order is found on the device.');
  }

  async order(): Promise<Uint32Array> {
    if (!this.parts) return new Uint32Array();
    const { order } = this.parts;
    const [count] = await readWords(this.device, order.counts, DepthOrder.VISIBLE, 1);
    return readWords(this.device, order.order, 0, count);
  }

  get bytes(): number {
    return this.parts
      ? this.parts.buffers.bytes + (DepthOrder.BYTES + ColorPass.BYTES) * this.parts.buffers.scene.count
      : 0;
  }

  /** Everything up to the blended Gaussians. */
  private blend(
    encoder: GPUCommandEncoder,
    view: View,
    mode: Mode,
    style: SplatStyle,
    precision: Precision,
  ): GPUTexture {
    let blended = this.blended[precision];
    if (blended?.width !== view.width || blended.height !== view.height) {
      blended?.destroy();
      blended = this.blended[precision] = target(this.device, precision, view.width, view.height);
    }
    this.color(encoder, view, mode, style, precision);
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: blended.createView(), clearValue: [0, 0, 0, 0], loadOp: 'clear', storeOp: 'store' }],
    });
    this.parts?.splats.draw(pass, view, style, precision);
    pass.end();
    return blended;
  }

  private color(encoder: GPUCommandEncoder, view: View, mode: Mode, style: SplatStyle, precision: Precision): void {
    this.parts?.order.encode(encoder, view, style.size);
    this.parts?.colors.encode(encoder, view, mode, precision);
  }

  private draw(view: View, picture: Picture, to: GPUTexture, precision: Precision): void {
    const encoder = this.device.createCommandEncoder();
    const blended = this.blend(encoder, view, picture.mode, picture.splats, precision);
    this.resolve.encode(encoder, blended, picture, this.parts?.buffers.scene.photometric?.response, to);
    this.device.queue.submit([encoder.finish()]);
  }

  render(view: View, picture: Picture): void {
    this.draw(view, picture, this.context.getCurrentTexture(), this.precision);
    void this.count();
  }

  /** Learns how many Gaussians were drawn, when the device comes to it. */
  private async count(): Promise<void> {
    this.isUncounted = true;
    if (this.isCounting) return;
    this.isCounting = true;
    while (this.isUncounted && this.parts) {
      this.isUncounted = false;
      const { parts } = this;
      // the device was lost
      const [drawn] = await readWords(this.device, parts.order.counts, DepthOrder.VISIBLE, 1).catch(() => [0]);
      if (this.parts !== parts) continue;
      this.drawn = drawn;
      this.counted();
    }
    this.isCounting = false;
  }

  async renderPixels(view: View, picture: Picture, precision: Precision = this.precision): Promise<Uint8Array> {
    const to = target(this.device, 'byte', view.width, view.height, GPUTextureUsage.COPY_SRC);
    this.draw(view, picture, to, precision);
    const pixels = await readPixels(this.device, to);
    to.destroy();
    return pixels;
  }

  private async time(encode: (encoder: GPUCommandEncoder) => void): Promise<void> {
    const encoder = this.device.createCommandEncoder();
    encode(encoder);
    this.device.queue.submit([encoder.finish()]);
    await this.device.queue.onSubmittedWorkDone();
  }

  timeFrame(view: View): Promise<void> {
    return this.time((encoder) => this.blend(encoder, view, 'full', PLAIN_SPLATS, 'byte'));
  }

  timeColors(view: View): Promise<void> {
    // in the order of the last frame
    return this.time((encoder) => this.parts?.colors.encode(encoder, view, 'full', 'byte'));
  }
}
