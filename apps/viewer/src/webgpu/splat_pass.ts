// SPDX-License-Identifier: Apache-2.0
// A quad per Gaussian, back to front, blended over what is behind it.

import type { View } from '../camera/view';
import fragmentGlsl from '../render/fragment.glsl?raw';
import gaussianGlsl from '../render/gaussian.glsl?raw';
import splatGlsl from '../render/splat.glsl?raw';
import { splatDefines, splatValues, type SplatStyle } from '../render/splats';
import type { Precision } from '../render/target';
import { isInBytes, type ColorPass } from './color_pass';
import type { DepthOrder } from './depth_order';
import { bind, bufferLayout, once, shaderModule, storage } from './kernel';
import { Parameters } from './parameters';
import type { SceneBuffers } from './scene_buffers';
import splatsCode from './splats.wgsl?raw';
import { TARGET_FORMATS } from './targets';
import { translate } from './translate';

export class SplatPass {
  private readonly parameters = new Parameters({
    rotation: 'mat3',
    translation: 'vec3',
    intrinsics: 'vec4',
    size: 'vec2',
    splat_size: 'float',
    near_plane: 'float',
  });
  private readonly view: GPUBuffer;
  private readonly pipelines: Partial<Record<Precision, GPURenderPipeline>> = {};
  private readonly layout: GPUBindGroupLayout;
  private readonly buffers: GPUBindGroup;
  private readonly code: string;

  constructor(
    private readonly device: GPUDevice,
    private readonly scene: SceneBuffers,
    private readonly order: DepthOrder,
    colors: ColorPass,
  ) {
    this.view = storage(device, this.parameters.bytes.byteLength);
    this.layout = bufferLayout(device, ['read', 'read', 'read', 'read'], GPUShaderStage.VERTEX);
    this.buffers = bind(device, this.layout, [this.view, scene.geometry, order.order, colors.colors]);
    this.code =
      this.parameters.declaration('View') +
      splatsCode +
      translate(gaussianGlsl + splatGlsl + fragmentGlsl, splatDefines(scene.scene), this.parameters.known('view'));
  }

  private pipeline(precision: Precision): GPURenderPipeline {
    const over = { srcFactor: 'one', dstFactor: 'one-minus-src-alpha', operation: 'add' } as const;
    const code = `const kEightBits = ${isInBytes(this.scene.scene, precision)};\n${this.code}`;
    const format = TARGET_FORMATS[precision];
    return once(this.device, JSON.stringify([format, code]), () => {
      const module = shaderModule(this.device, code);
      return this.device.createRenderPipeline({
        layout: this.device.createPipelineLayout({ bindGroupLayouts: [this.layout] }),
        vertex: { module, entryPoint: 'corner' },
        fragment: { module, entryPoint: 'blend', targets: [{ format, blend: { color: over, alpha: over } }] },
        primitive: { topology: 'triangle-strip' },
      });
    });
  }

  /** Into `pass`, whose target has this precision. */
  draw(pass: GPURenderPassEncoder, view: View, style: SplatStyle, precision: Precision): void {
    this.parameters.set(splatValues(view, style));
    this.device.queue.writeBuffer(this.view, 0, this.parameters.bytes);
    pass.setPipeline((this.pipelines[precision] ??= this.pipeline(precision)));
    pass.setBindGroup(0, this.buffers);
    pass.drawIndirect(this.order.counts, 0);
  }

  dispose(): void {
    this.view.destroy();
  }
}
