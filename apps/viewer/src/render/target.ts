// SPDX-License-Identifier: Apache-2.0
// Textures that are drawn into.

import { HalfFloatType, NearestFilter, RGBAFormat, UnsignedByteType, WebGLRenderTarget } from 'three';

/** Half floats keep what eight bits would round after every Gaussian and cut off above 1. */
export type Precision = 'half' | 'byte';

export function renderTarget(precision: Precision, width = 1, height = 1): WebGLRenderTarget {
  const type = precision === 'half' ? HalfFloatType : UnsignedByteType;
  return new WebGLRenderTarget(width, height, {
    format: RGBAFormat,
    type,
    minFilter: NearestFilter,
    magFilter: NearestFilter,
    depthBuffer: false,
  });
}

export function targetBytes(target: WebGLRenderTarget): number {
  return target.width * target.height * (target.texture.type === HalfFloatType ? 8 : 4);
}
