// SPDX-License-Identifier: Apache-2.0
// What TypeScript's own declarations of WebGPU leave out.

declare const GPUBufferUsage: Readonly<Record<'MAP_READ' | 'COPY_SRC' | 'COPY_DST' | 'STORAGE' | 'INDIRECT', number>>;
declare const GPUTextureUsage: Readonly<Record<'COPY_SRC' | 'TEXTURE_BINDING' | 'RENDER_ATTACHMENT', number>>;
declare const GPUShaderStage: Readonly<Record<'VERTEX' | 'COMPUTE', number>>;
declare const GPUMapMode: Readonly<Record<'READ', number>>;

interface HTMLCanvasElement {
  getContext(contextId: 'webgpu'): GPUCanvasContext | null;
}
