// SPDX-License-Identifier: Apache-2.0
// The colour of every Gaussian for one camera, into a texture of a pixel each.

import type { WebGLRenderer, WebGLRenderTarget } from 'three';
import { ColorActivation, IMPORTANCE_CLASSES, TEXTURE_WIDTH, type Scene } from '../format/ngsplat';
import type { View } from '../camera/view';
import { dot } from '../format/vector';
import type { GpuScene } from './gpu_scene';
import { fullscreenPass, uniforms, type Defines, type Pass } from './pass';
import { renderTarget, type Precision } from './target';
import gaussianCode from './gaussian.glsl?raw';
import prepassCode from './prepass.frag.glsl?raw';
import colorsCode from './colors.glsl?raw';

export type Mode = 'full' | 'base' | 'residual' | 'depth' | 'appearance';
export const MODES: readonly Mode[] = ['full', 'base', 'residual', 'depth', 'appearance'];

/** What the GLSL of the colours is told of a file. */
export function colorDefines(scene: Scene): Defines {
  const quads = scene.payload.find((block) => block.words === 4)?.layers ?? 0;
  return {
    GS_HALVES: 8 * quads,
    GS_FLOATS: scene.floats.length,
    GS_WEIGHTS: scene.weights.length / 4,
    GS_HAS_RESIDUAL: scene.payload.length > 0,
    GS_COLOR_ACTIVATION: scene.colorActivation,
    GS_RESIDUAL_ACTIVATION: scene.residualActivation,
    GS_EXPONENTIAL_BASE: scene.exponentialBase,
    GS_CLASSES: scene.isInterleaved ? IMPORTANCE_CLASSES : 1,
    ...scene.constants,
  };
}

/** Depth of the scene's centre, or where that is beside or behind the camera, of something as far. */
function centerDepth(scene: Scene, view: View): number {
  return Math.max(dot(view.forward, scene.center) - dot(view.forward, view.position), 0.1 * scene.distance, 1e-3);
}

/** The depth that the mode `depth` shows in a grey from 0 to 1. */
export const depthOf = (scene: Scene, view: View, grey: number): number =>
  centerDepth(scene, view) * Math.cbrt(1 / grey - 1);

/** Whether colours above 1 occur, which eight bits would cut off. */
export function isUnbounded(activation: ColorActivation): boolean {
  return [ColorActivation.Relu, ColorActivation.Softplus, ColorActivation.None].includes(activation);
}

/** What the GLSL of the colours takes from a view. */
export function colorValues(scene: Scene, view: View, mode: Mode) {
  return {
    camera_position: view.position,
    camera_forward: view.forward,
    center_depth: centerDepth(scene, view),
    mode: MODES.indexOf(mode),
  };
}

export class Prepass {
  private readonly targets: Partial<Record<Precision, WebGLRenderTarget>> = {};
  private readonly pass: Pass;

  constructor(private readonly gpu: GpuScene) {
    const { scene } = gpu;
    // Without stored residual the model's code is not even compiled.
    const model = scene.payload.length > 0 ? scene.model.glsl : '';
    this.pass = fullscreenPass(
      `${gaussianCode}${prepassCode}${colorsCode}${model}`,
      uniforms({
        geometry: gpu.geometry,
        payload_quads: gpu.quads,
        payload_pairs: gpu.pairs,
        ...(scene.floats.length > 0 ? { header_floats: scene.floats } : {}),
        base_scale: scene.baseScale,
        base_offset: scene.baseOffset,
        count: scene.count,
        num_residuals: 0,
        camera_position: [0, 0, 0],
        camera_forward: [0, 0, 1],
        center_depth: 1,
        mode: 0,
      }),
      colorDefines(scene),
    );
    if (scene.weights.length > 0) this.pass.material.uniformsGroups = [gpu.weights];
  }

  /** All texels are there: until now every Gaussian has its base colour. */
  complete(): void {
    const { scene } = this.gpu;
    this.pass.set({ num_residuals: scene.payload.length > 0 ? scene.numResiduals : 0 });
  }

  /** Where the colours are, in no more than `precision`. */
  target(precision: Precision): WebGLRenderTarget {
    const { scene } = this.gpu;
    const type = precision === 'half' && isUnbounded(scene.colorActivation) ? 'half' : 'byte';
    return (this.targets[type] ??= renderTarget(type, TEXTURE_WIDTH, scene.textureHeight));
  }

  draw(renderer: WebGLRenderer, view: View, mode: Mode, precision: Precision): void {
    this.pass.set(colorValues(this.gpu.scene, view, mode));
    this.pass.draw(renderer, this.target(precision));
  }

  dispose(): void {
    this.pass.dispose();
    for (const target of Object.values(this.targets)) target.dispose();
  }
}
