// SPDX-License-Identifier: Apache-2.0
// The data of one file on the GPU.

import {
  DataArrayTexture, DataTexture, NearestFilter, RGBAIntegerFormat, RGIntegerFormat, Uniform, UniformsGroup, UnsignedIntType, Vector4, type Texture,
  type WebGLRenderer,
} from 'three';
import { halfToFloat } from '../format/half';
import { TEXTURE_WIDTH, type Scene } from '../format/ngsplat';

function integers<T extends Texture>(texture: T, internalFormat: 'RG32UI' | 'RGBA32UI'): T {
  texture.format = internalFormat === 'RG32UI' ? RGIntegerFormat : RGBAIntegerFormat;
  texture.type = UnsignedIntType;
  texture.internalFormat = internalFormat;
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.unpackAlignment = 4;
  texture.needsUpdate = true;
  return texture;
}

/** Weights of a network as a uniform block: every device has room for 1024 vectors, twice what the largest variant takes. */
function weightsBlock(halves: Uint16Array): UniformsGroup {
  const vectors: Vector4[] = [];
  for (let i = 0; i < halves.length; i += 4) vectors.push(new Vector4(...[...halves.subarray(i, i + 4)].map(halfToFloat)));
  const group = new UniformsGroup();
  group.setName('Weights');
  group.add(new Uniform(vectors));
  return group;
}

export class GpuScene {
  readonly geometry: DataTexture;
  readonly quads: DataArrayTexture;
  readonly pairs: DataTexture;
  readonly weights: UniformsGroup;
  /** Bytes of the textures. */
  readonly bytes: number;

  /** `scene` has at least one Gaussian. */
  constructor(readonly scene: Scene) {
    this.geometry = integers(new DataTexture(scene.geometry, TEXTURE_WIDTH, scene.textureHeight), 'RGBA32UI');
    // Every sampler of a shader needs a texture of its kind, also where the file has nothing for it.
    const height = scene.payloadHeight;
    const block = (words: number) => (height > 0 ? scene.payload.find((candidate) => candidate.words === words) : undefined);
    const quads = block(4), pairs = block(2);
    this.quads = integers(quads ? new DataArrayTexture(quads.data, TEXTURE_WIDTH, height, quads.layers) : new DataArrayTexture(new Uint32Array(4), 1, 1, 1), 'RGBA32UI');
    this.pairs = integers(pairs ? new DataTexture(pairs.data, TEXTURE_WIDTH, height) : new DataTexture(new Uint32Array(2), 1, 1), 'RG32UI');
    this.weights = weightsBlock(scene.weights);
    this.bytes = scene.geometry.byteLength + 2 * scene.weights.byteLength + scene.payload.reduce((sum, block) => sum + block.data.byteLength, 0);
  }

  private get textures(): (DataTexture | DataArrayTexture)[] {
    return [this.geometry, this.quads, this.pairs];
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
    this.weights.dispose();
  }
}
