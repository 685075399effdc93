// SPDX-License-Identifier: Apache-2.0
// A quad per Gaussian, back to front, blended over what is behind it.

import {
  AddEquation,
  BufferAttribute,
  CustomBlending,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  OneFactor,
  OneMinusSrcAlphaFactor,
  type RenderTarget,
  type Texture,
  type WebGLRenderer,
} from 'three';
import { camFromWorld, type View } from '../camera/view';
import type { Scene } from '../format/ngsplat';
import type { GpuScene } from './gpu_scene';
import { Pass, uniforms, type Defines } from './pass';
import gaussianCode from './gaussian.glsl?raw';
import vertexCode from './splat.vert.glsl?raw';
import cornerCode from './splat.glsl?raw';
import blendingCode from './fragment.glsl?raw';
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

/** What the GLSL of the splats is told of a file. */
export function splatDefines({ antialiased }: Scene): Defines {
  return { GS_ANTIALIASED: antialiased, GS_DILATION: antialiased ? 0.1 : 0.3 };
}

/** What it takes from a view. */
export function splatValues(view: View, style: SplatStyle) {
  return {
    ...camFromWorld(view),
    intrinsics: [view.fx, view.fy, view.cx, view.cy],
    size: [view.width, view.height],
    splat_size: style.size,
    near_plane: Math.max(PLAIN_SPLATS.near, style.near),
  };
}

export class Splats {
  private readonly geometry = new InstancedBufferGeometry();
  private readonly attribute: InstancedBufferAttribute;
  private readonly pass: Pass;

  constructor(gpu: GpuScene) {
    this.geometry.setAttribute(
      'position',
      new BufferAttribute(new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), 3),
    );
    this.geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.attribute = new InstancedBufferAttribute(new Uint32Array(gpu.scene.count), 1);
    this.geometry.setAttribute('order', this.attribute);
    this.geometry.instanceCount = 0;
    this.pass = new Pass(
      this.geometry,
      gaussianCode + vertexCode + cornerCode,
      blendingCode + fragmentCode,
      uniforms({
        geometry: gpu.geometry,
        colors: null,
        rotation: null,
        translation: null,
        intrinsics: null,
        size: null,
        splat_size: 1,
        near_plane: 0,
      }),
      splatDefines(gpu.scene),
      {
        transparent: true,
        blending: CustomBlending,
        blendEquation: AddEquation,
        blendSrc: OneFactor,
        blendDst: OneMinusSrcAlphaFactor,
      },
    );
  }

  get count(): number {
    return this.geometry.instanceCount;
  }

  get order(): Uint32Array {
    return (this.attribute.array as Uint32Array).slice(0, this.count);
  }

  /** The first `count` of `order` are drawn in this order. Returns the array that held the order before. */
  setOrder(order: Uint32Array, count: number): Uint32Array {
    const before = this.attribute.array as Uint32Array;
    this.attribute.array = order;
    this.attribute.clearUpdateRanges();
    this.attribute.addUpdateRange(0, count);
    this.attribute.needsUpdate = true;
    this.geometry.instanceCount = count;
    return before;
  }

  draw(renderer: WebGLRenderer, view: View, style: SplatStyle, colors: Texture, target: RenderTarget): void {
    this.pass.set({ colors, ...splatValues(view, style) });
    this.pass.draw(renderer, target);
  }

  dispose(): void {
    this.pass.dispose();
  }
}
