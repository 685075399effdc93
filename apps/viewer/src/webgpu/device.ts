// SPDX-License-Identifier: Apache-2.0
// The device that WebGPU gives, and the choice between it and WebGL2.

import { RenderError } from '../render/scene_renderer';

/** What `?gpu=` may say. */
export type Way = 'webgl' | 'webgpu';

/** Older browsers say it of the adapter itself, and have no info. */
function isSoftware(adapter: { info?: GPUAdapterInfo; isFallbackAdapter?: boolean }): boolean {
  return adapter.info?.isFallbackAdapter ?? adapter.isFallbackAdapter ?? false;
}

/**
 * Undefined where WebGL2 is to be used: WebGPU is not there, or draws in software. Throws RenderError where it is
 * `wanted` and not there.
 */
export async function findDevice(wanted: string | null): Promise<GPUDevice | undefined> {
  if (wanted !== null && wanted !== 'webgl' && wanted !== 'webgpu')
    throw new RenderError(`The address says gpu=${wanted}; it can be webgl or webgpu.`);
  const adapter =
    wanted === 'webgl'
      ? null
      : await navigator.gpu?.requestAdapter({ powerPreference: 'high-performance' }).catch(() => null);
  if (adapter && (wanted === 'webgpu' || !isSoftware(adapter))) {
    const { maxBufferSize, maxStorageBufferBindingSize } = adapter.limits;
    const device = await adapter
      .requestDevice({ requiredLimits: { maxBufferSize, maxStorageBufferBindingSize } })
      .catch(() => undefined);
    if (device) return device;
  }
  if (wanted === 'webgpu')
    throw new RenderError('The address asks for WebGPU, which this browser does not offer here or has switched off.');
  return undefined;
}
