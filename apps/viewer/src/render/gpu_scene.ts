// SPDX-License-Identifier: Apache-2.0
// The data of one file on the GPU.

import {
  DataArrayTexture,
  DataTexture,
  NearestFilter,
  RGBAIntegerFormat,
  RGIntegerFormat,
  Uniform,
  UniformsGroup,
  UnsignedIntType,
  Vector3,
  Vector4,
  type WebGLRenderer,
} from 'three';
import { halfToFloat } from '../format/half';
import { TEXTURE_WIDTH, type Scene } from '../format/ngsplat';
import { planeBytes, planesOf, type Plane } from '../format/reader';

/**
 * Weights of a network as a uniform block: every device has room for 1024 vectors, twice what the largest variant
 * takes.
 */
function weightsBlock(halves: Uint16Array): UniformsGroup {
  const vectors: Vector4[] = [];
  for (let i = 0; i < halves.length; i += 4)
    vectors.push(new Vector4(...[...halves.subarray(i, i + 4)].map(halfToFloat)));
  const group = new UniformsGroup();
  group.setName('Weights');
  group.add(new Uniform(vectors));
  return group;
}

/** Memory on the GPU, which texels are written to later. */
function storage<T extends DataTexture | DataArrayTexture>(texture: T, internalFormat: 'RG32UI' | 'RGBA32UI'): T {
  texture.source.dataReady = false;
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
  readonly weights: UniformsGroup;
  /** Bytes of the textures. */
  readonly bytes: number;

  /** `scene` has at least one Gaussian. */
  constructor(readonly scene: Scene) {
    this.geometry = storage(new DataTexture(null, TEXTURE_WIDTH, scene.textureHeight), 'RGBA32UI');
    // Every sampler of a shader needs a texture of its kind, also where the file has nothing for it.
    const height = scene.payloadHeight;
    const layers = (words: number) =>
      height > 0 ? (scene.payload.find((candidate) => candidate.words === words)?.layers ?? 0) : 0;
    const quads = layers(4);
    const pairs = layers(2);
    this.quads = storage(
      quads ? new DataArrayTexture(null, TEXTURE_WIDTH, height, quads) : new DataArrayTexture(null, 1, 1, 1),
      'RGBA32UI',
    );
    this.pairs = storage(pairs ? new DataTexture(null, TEXTURE_WIDTH, height) : new DataTexture(null, 1, 1), 'RG32UI');
    this.weights = weightsBlock(scene.weights);
    this.bytes = planesOf(scene).reduce((sum, plane) => sum + planeBytes(plane), 4 * scene.weights.length);
  }

  private get textures(): (DataTexture | DataArrayTexture)[] {
    return [this.geometry, this.quads, this.pairs];
  }

  /** Takes the memory. */
  allocate(renderer: WebGLRenderer): void {
    for (const texture of this.textures) renderer.initTexture(texture);
  }

  /** Copies rows of a texture to the GPU. */
  write(renderer: WebGLRenderer, plane: Plane, row: number, texels: Uint32Array): void {
    const to = plane.block < 0 ? this.geometry : plane.words === 4 ? this.quads : this.pairs;
    const from = new DataTexture(texels, TEXTURE_WIDTH, texels.length / (plane.words * TEXTURE_WIDTH));
    renderer.copyTextureToTexture(from, to, null, new Vector3(0, row, plane.layer));
  }

  dispose(): void {
    for (const texture of this.textures) texture.dispose();
    this.weights.dispose();
  }
}
