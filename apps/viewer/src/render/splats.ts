// SPDX-License-Identifier: Apache-2.0
// A quad per Gaussian, back to front, blended over what is behind it.

import {
  AddEquation, BufferAttribute, CustomBlending, InstancedBufferAttribute, InstancedBufferGeometry, OneFactor, OneMinusSrcAlphaFactor, type RenderTarget, type Texture,
  type WebGLRenderer,
} from 'three';
import { camFromWorld, type View } from '../camera/view';
import type { GpuScene } from './gpu_scene';
import { Pass, uniforms } from './pass';
import gaussianCode from './gaussian.glsl?raw';
import vertexCode from './splat.vert.glsl?raw';
import fragmentCode from './splat.frag.glsl?raw';

/** How Gaussians are drawn. */
export interface SplatStyle {
  /** A factor of all scales; 0 makes points. */
  size: number;
  /** Depth below which nothing is drawn. */
  near: number;
}

/** As gsapp draws them: kNear in kernels/splat/raster_config.h is this near plane. */
export const PLAIN_SPLATS: SplatStyle = { size: 1, near: 0.2 };

export class Splats {
  private readonly geometry = new InstancedBufferGeometry();
  private readonly order: InstancedBufferAttribute;
  private readonly pass: Pass;

  constructor(gpu: GpuScene) {
    this.geometry.setAttribute('position', new BufferAttribute(new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), 3));
    this.geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.order = new InstancedBufferAttribute(new Uint32Array(gpu.scene.count), 1);
    this.geometry.setAttribute('order', this.order);
    this.geometry.instanceCount = 0;
    const { antialiased } = gpu.scene;
    this.pass = new Pass(this.geometry, gaussianCode + vertexCode, fragmentCode, uniforms({
      geometry: gpu.geometry, colors: null, rotation: null, translation: null, intrinsics: null, size: null, splat_size: 1, near_plane: 0,
    }), { GS_ANTIALIASED: antialiased, GS_DILATION: antialiased ? 0.1 : 0.3 }, {
      transparent: true, blending: CustomBlending, blendEquation: AddEquation, blendSrc: OneFactor, blendDst: OneMinusSrcAlphaFactor,
    });
  }

  get count(): number {
    return this.geometry.instanceCount;
  }

  /** The first `count` of `order` are drawn in this order. Returns the array that held the order before. */
  setOrder(order: Uint32Array, count: number): Uint32Array {
    const before = this.order.array as Uint32Array;
    this.order.array = order;
    this.order.clearUpdateRanges();
    this.order.addUpdateRange(0, count);
    this.order.needsUpdate = true;
    this.geometry.instanceCount = count;
    return before;
  }

  draw(renderer: WebGLRenderer, view: View, style: SplatStyle, colors: Texture, target: RenderTarget): void {
    this.pass.set({
      colors, ...camFromWorld(view), intrinsics: [view.fx, view.fy, view.cx, view.cy], size: [view.width, view.height],
      splat_size: style.size, near_plane: Math.max(PLAIN_SPLATS.near, style.near),
    });
    this.pass.draw(renderer, target);
  }

  dispose(): void {
    this.pass.dispose();
  }
}
