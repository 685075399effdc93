// SPDX-License-Identifier: Apache-2.0
// A pass: one mesh with one shader, drawn into one target. What three.js does beyond that is left out.

import {
  BufferAttribute,
  BufferGeometry,
  Camera,
  DoubleSide,
  GLSL3,
  Mesh,
  NoBlending,
  RawShaderMaterial,
  Scene,
  type IUniform,
  type RenderTarget,
  type ShaderMaterialParameters,
  type WebGLRenderer,
} from 'three';
import fullscreenVertex from './fullscreen.vert.glsl?raw';

const camera = new Camera();
const PRECISION = 'precision highp float;\nprecision highp int;\n';

/** Of a shader program: lines of `#define NAME VALUE`, with booleans as 0 and 1. */
export type Defines = Record<string, number | boolean | string>;

export class Pass {
  readonly material: RawShaderMaterial;
  private readonly scene = new Scene();

  constructor(
    readonly geometry: BufferGeometry,
    vertexShader: string,
    fragmentShader: string,
    uniforms: Record<string, IUniform>,
    defines: Defines = {},
    parameters: ShaderMaterialParameters = {},
  ) {
    const head =
      PRECISION +
      Object.entries(defines)
        .map(([name, value]) => `#define ${name} ${typeof value === 'boolean' ? Number(value) : value}\n`)
        .join('');
    this.material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: head + vertexShader,
      fragmentShader: head + fragmentShader,
      uniforms,
      depthTest: false,
      depthWrite: false,
      side: DoubleSide,
      blending: NoBlending,
      ...parameters,
    });
    const mesh = new Mesh(geometry, this.material);
    mesh.frustumCulled = false;
    this.scene.add(mesh);
  }

  set(values: Record<string, unknown>): void {
    for (const [name, value] of Object.entries(values)) this.material.uniforms[name].value = value;
  }

  draw(renderer: WebGLRenderer, target: RenderTarget | null): void {
    renderer.setRenderTarget(target as Parameters<WebGLRenderer['setRenderTarget']>[0]);
    renderer.render(this.scene, camera);
  }

  dispose(): void {
    this.material.dispose();
    this.geometry.dispose();
  }
}

export function fullscreenPass(
  fragmentShader: string,
  uniforms: Record<string, IUniform>,
  defines: Defines = {},
): Pass {
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
  return new Pass(geometry, fullscreenVertex, fragmentShader, uniforms, defines);
}

export function uniforms(values: Record<string, unknown>): Record<string, IUniform> {
  return Object.fromEntries(Object.entries(values).map(([name, value]) => [name, { value }]));
}
