// SPDX-License-Identifier: Apache-2.0
// Programs on the device and what they read and write: buffers alone, in the order of their bindings.

/** Threads of a workgroup, in all compute shaders here. */
export const GROUP = 256;

export type Access = 'read' | 'write';

/** A layout of buffers, written with as the shaders declare them. */
export function bufferLayout(device: GPUDevice, accesses: Access[], visibility: number): GPUBindGroupLayout {
  return device.createBindGroupLayout({
    entries: accesses.map((access, binding) => ({ binding, visibility, buffer: { type: access === 'read' ? 'read-only-storage' : 'storage' } })),
  });
}

export function bind(device: GPUDevice, layout: GPUBindGroupLayout, buffers: GPUBuffer[]): GPUBindGroup {
  return device.createBindGroup({ layout, entries: buffers.map((buffer, binding) => ({ binding, resource: { buffer } })) });
}

export function computePipeline(device: GPUDevice, layout: GPUBindGroupLayout, code: string, entryPoint: string, constants: Record<string, number> = {}): GPUComputePipeline {
  const module = device.createShaderModule({ code });
  return device.createComputePipeline({ layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }), compute: { module, entryPoint, constants } });
}

/** Zeros, `bytes` of them; a buffer is never empty. */
export function storage(device: GPUDevice, bytes: number, usage = 0): GPUBuffer {
  return device.createBuffer({ size: Math.max(16, 4 * Math.ceil(bytes / 4)), usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST | usage });
}
