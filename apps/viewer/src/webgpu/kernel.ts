// SPDX-License-Identifier: Apache-2.0
// Programs on the device and what they read and write: buffers alone, in the order of their bindings.

/** Threads of a workgroup, in all compute shaders here. */
export const GROUP = 256;

export type Access = 'read' | 'write';

/** A layout of buffers, written with as the shaders declare them. */
export function bufferLayout(device: GPUDevice, accesses: Access[], visibility: number): GPUBindGroupLayout {
  return device.createBindGroupLayout({
    entries: accesses.map((access, binding) => ({
      binding,
      visibility,
      buffer: { type: access === 'read' ? 'read-only-storage' : 'storage' },
    })),
  });
}

export function bind(device: GPUDevice, layout: GPUBindGroupLayout, buffers: GPUBuffer[]): GPUBindGroup {
  return device.createBindGroup({
    layout,
    entries: buffers.map((buffer, binding) => ({ binding, resource: { buffer } })),
  });
}

/** What `once` made. */
const made = new WeakMap<GPUDevice, Map<string, object>>();

/**
 * Calls `make` once on a device for each `description`, and returns its result every time: compiling takes time, and most
 * shaders of a model are those of the one before.
 */
export function once<T extends object>(device: GPUDevice, description: string, make: () => T): T {
  const things = made.get(device) ?? new Map<string, object>();
  made.set(device, things);
  const thing = (things.get(description) as T | undefined) ?? make();
  things.set(description, thing);
  return thing;
}

export function shaderModule(device: GPUDevice, code: string): GPUShaderModule {
  return once(device, code, () => device.createShaderModule({ code }));
}

/** A pipeline takes the buffers of any layout that is equal to `layout`. */
export function computePipeline(
  device: GPUDevice,
  layout: GPUBindGroupLayout,
  code: string,
  entryPoint: string,
  constants: Record<string, number> = {},
): GPUComputePipeline {
  return once(device, JSON.stringify([entryPoint, constants, code]), () =>
    device.createComputePipeline({
      layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
      compute: { module: shaderModule(device, code), entryPoint, constants },
    }),
  );
}

/** Zeros, `bytes` of them; a buffer is never empty. */
export function storage(device: GPUDevice, bytes: number, usage = 0): GPUBuffer {
  return device.createBuffer({
    size: Math.max(16, 4 * Math.ceil(bytes / 4)),
    usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST | usage,
  });
}
