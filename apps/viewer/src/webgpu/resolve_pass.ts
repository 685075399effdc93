// SPDX-License-Identifier: Apache-2.0
// The picture from the blended Gaussians: background, photometric correction, 8 bits.

import { correction } from '../render/photometric';
import type { Picture } from '../render/scene_renderer';
import resolveGlsl from '../render/resolve.glsl?raw';
import { storage } from './kernel';
import { Parameters } from './parameters';
import resolveCode from './resolve.wgsl?raw';
import { TARGET_FORMATS } from './targets';
import { translate } from './translate';

export class ResolvePass {
  private readonly parameters = new Parameters({
    background: 'vec3',
    corrected: 'bool',
    gain: 'float',
    mix_colors: 'mat3',
    response: 'float[18]',
  });
  private readonly data: GPUBuffer;
  private readonly pipeline: GPURenderPipeline;

  constructor(private readonly device: GPUDevice) {
    this.data = storage(device, this.parameters.bytes.byteLength);
    const code =
      this.parameters.declaration('Data') + resolveCode + translate(resolveGlsl, {}, this.parameters.known('data'));
    const module = device.createShaderModule({ code });
    this.pipeline = device.createRenderPipeline({
      layout: 'auto',
      vertex: { module, entryPoint: 'corner' },
      fragment: { module, entryPoint: 'pixel', targets: [{ format: TARGET_FORMATS.byte }] },
    });
  }

  encode(
    encoder: GPUCommandEncoder,
    blended: GPUTexture,
    picture: Picture,
    response: Float32Array | undefined,
    target: GPUTexture,
  ): void {
    this.parameters.set({ background: picture.background, ...correction(picture.exposure, response) });
    this.device.queue.writeBuffer(this.data, 0, this.parameters.bytes);
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: target.createView(), loadOp: 'clear', storeOp: 'store' }],
    });
    pass.setPipeline(this.pipeline);
    pass.setBindGroup(
      0,
      this.device.createBindGroup({
        layout: this.pipeline.getBindGroupLayout(0),
        entries: [
          { binding: 0, resource: { buffer: this.data } },
          { binding: 1, resource: blended.createView() },
        ],
      }),
    );
    pass.draw(3);
    pass.end();
  }
}
