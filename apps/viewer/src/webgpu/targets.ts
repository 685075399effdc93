// SPDX-License-Identifier: Apache-2.0
// Textures that are drawn into.

import type { Precision } from '../render/target';

export const TARGET_FORMATS: Record<Precision, GPUTextureFormat> = { half: 'rgba16float', byte: 'rgba8unorm' };

export function target(device: GPUDevice, precision: Precision, width: number, height: number, usage = 0): GPUTexture {
  return device.createTexture({
    size: [width, height],
    format: TARGET_FORMATS[precision],
    usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING | usage,
  });
}

/** The bytes of a texture with eight bits, rgba from the upper left. */
export async function readPixels(device: GPUDevice, texture: GPUTexture): Promise<Uint8Array> {
  const { width, height } = texture;
  const bytesPerRow = 256 * Math.ceil((4 * width) / 256); // copies of rows begin at multiples of 256
  const buffer = device.createBuffer({
    size: bytesPerRow * height,
    usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ,
  });
  const encoder = device.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer, bytesPerRow }, [width, height]);
  device.queue.submit([encoder.finish()]);
  await buffer.mapAsync(GPUMapMode.READ);
  const rows = new Uint8Array(buffer.getMappedRange());
  const out = new Uint8Array(4 * width * height);
  for (let y = 0; y < height; ++y) out.set(rows.subarray(bytesPerRow * y, bytesPerRow * y + 4 * width), 4 * width * y);
  buffer.destroy();
  return out;
}

/** Words of a buffer. */
export async function readWords(
  device: GPUDevice,
  from: GPUBuffer,
  offset: number,
  count: number,
): Promise<Uint32Array> {
  if (count === 0) return new Uint32Array();
  const buffer = device.createBuffer({ size: 4 * count, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
  const encoder = device.createCommandEncoder();
  encoder.copyBufferToBuffer(from, offset, buffer, 0, 4 * count);
  device.queue.submit([encoder.finish()]);
  await buffer.mapAsync(GPUMapMode.READ);
  const words = new Uint32Array(buffer.getMappedRange()).slice();
  buffer.destroy();
  return words;
}
