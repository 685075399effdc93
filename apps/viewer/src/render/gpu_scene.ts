// SPDX-License-Identifier: Apache-2.0
// The data of one file on the GPU.

import {
  DataArrayTexture, DataTexture, HalfFloatType, NearestFilter, RGBAFormat, RGBAIntegerFormat, RGIntegerFormat, UnsignedIntType, type Texture,
  type WebGLRenderer,
} from 'three';
import { shFactors, TEXTURE_WIDTH, type Scene } from '../format/ngsplat';

/** Texels of weights in a row. */
const WEIGHTS_WIDTH = 64;

function integers<T extends Texture>(texture: T, internalFormat: 'RG32UI' | 'RGBA32UI'): T {
  texture.format = internalFormat === 'RG32UI' ? RGIntegerFormat : RGBAIntegerFormat;
  texture.type = UnsignedIntType;
  texture.internalFormat = internalFormat;
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.unpackAlignment = 4;
  texture.needsUpdate = true;
  return texture;
}

export class GpuScene {
  readonly geometry: DataTexture;
  readonly quads: DataArrayTexture;
  readonly pairs: DataTexture;
  readonly weights: DataTexture;
  readonly shFactors: number[];
  /** Bytes of the textures. */
  readonly bytes: number;

  /** `scene` has at least one Gaussian. */
  constructor(readonly scene: Scene) {
    const height = scene.textureHeight;
    this.geometry = integers(new DataTexture(scene.geometry, TEXTURE_WIDTH, height), 'RGBA32UI');
    // Every sampler of a shader needs a texture of its kind, also where the file has nothing for it.
    const quads = scene.payload.find((block) => block.words === 4);
    const pairs = scene.payload.find((block) => block.words === 2);
    this.quads = integers(quads ? new DataArrayTexture(quads.data, TEXTURE_WIDTH, height, quads.layers) : new DataArrayTexture(new Uint32Array(4), 1, 1, 1), 'RGBA32UI');
    this.pairs = integers(pairs ? new DataTexture(pairs.data, TEXTURE_WIDTH, height) : new DataTexture(new Uint32Array(2), 1, 1), 'RG32UI');
    const rows = Math.max(1, Math.ceil(scene.weights.length / 4 / WEIGHTS_WIDTH));
    const weights = new Uint16Array(4 * WEIGHTS_WIDTH * rows);
    weights.set(scene.weights);
    this.weights = new DataTexture(weights, WEIGHTS_WIDTH, rows, RGBAFormat, HalfFloatType);
    this.weights.needsUpdate = true;
    this.shFactors = shFactors(scene.shScales);
    this.bytes = scene.geometry.byteLength + weights.byteLength + scene.payload.reduce((sum, block) => sum + block.data.byteLength, 0);
  }

  private get textures(): (DataTexture | DataArrayTexture)[] {
    return [this.geometry, this.quads, this.pairs, this.weights];
  }

  /** Copies all to the GPU and lets go of the file's bytes. */
  upload(renderer: WebGLRenderer): void {
    for (const texture of this.textures) {
      renderer.initTexture(texture);
      texture.image.data = null;
    }
    this.scene.geometry = new Uint32Array();
    for (const block of this.scene.payload) block.data = new Uint32Array();
  }

  dispose(): void {
    for (const texture of this.textures) texture.dispose();
  }
}
