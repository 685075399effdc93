// SPDX-License-Identifier: Apache-2.0
// The colours of the Gaussians in the view: the appearance of no other is computed.

import type { View } from '../camera/view';
import { colorDefines, colorValues, isUnbounded, type Mode } from '../render/prepass';
import type { Precision } from '../render/target';
import colorsGlsl from '../render/colors.glsl?raw';
import gaussianGlsl from '../render/gaussian.glsl?raw';
import { TEXTURE_WIDTH, type Scene } from '../format/ngsplat';
import { halfToFloat } from '../format/half';
import colorsCode from './colors.wgsl?raw';
import countsCode from './counts.wgsl?raw';
import { DepthOrder } from './depth_order';
import { bind, bufferLayout, computePipeline, storage } from './kernel';
import { Parameters } from './parameters';
import type { SceneBuffers } from './scene_buffers';
import { translate } from './translate';

/**
 * Whether a file's colours are held with eight bits in pictures of this precision: the same choice as Prepass makes.
 */
export const isInBytes = (scene: Scene, precision: Precision): boolean =>
  precision === 'byte' || !isUnbounded(scene.colorActivation);

function parametersOf(scene: Scene): Parameters {
  const arrays = {
    header_floats: ['float', scene.floats.length],
    weights: ['vec4', scene.weights.length / 4],
  } as const;
  const lists = Object.entries(arrays).flatMap(([name, [type, length]]) =>
    length > 0 ? [[name, `${type}[${length}]`]] : [],
  );
  return new Parameters({
    base_scale: 'float',
    base_offset: 'float',
    camera_position: 'vec3',
    camera_forward: 'vec3',
    center_depth: 'float',
    count: 'int',
    num_residuals: 'int',
    mode: 'int',
    layer_texels: 'int',
    ...Object.fromEntries(lists),
  });
}

export class ColorPass {
  /** Of a Gaussian. */
  static readonly BYTES = 8;
  /** Of what is in the view, in the order of the splats. */
  readonly colors: GPUBuffer;
  private readonly parameters: Parameters;
  private readonly data: GPUBuffer;
  private readonly pipelines: Partial<Record<'byte' | 'half', GPUComputePipeline>> = {};
  private readonly layout: GPUBindGroupLayout;
  private readonly buffers: GPUBindGroup;
  private readonly code: string;

  /** Throws Error where the model's GLSL is not understood. */
  constructor(
    private readonly device: GPUDevice,
    private readonly scene: SceneBuffers,
    private readonly order: DepthOrder,
  ) {
    const { scene: file } = scene;
    const parameters = (this.parameters = parametersOf(file));
    parameters.set({
      base_scale: file.baseScale,
      base_offset: file.baseOffset,
      count: file.count,
      layer_texels: TEXTURE_WIDTH * file.payloadHeight,
      ...(file.floats.length > 0 ? { header_floats: file.floats } : {}),
      ...(file.weights.length > 0 ? { weights: [...file.weights].map(halfToFloat) } : {}),
    });
    // Without stored residual the model's code is not even compiled.
    const glsl = gaussianGlsl + colorsGlsl + (file.payload.length > 0 ? file.model.glsl : '');
    this.code =
      parameters.declaration('Data') +
      countsCode +
      colorsCode +
      translate(glsl, colorDefines(file), {
        ...parameters.known('data'),
        row: { code: 'row', type: 'int' },
        payload: { code: 'payload', type: 'uvec4', parameters: [{ type: 'int', isOut: false }] },
        payload_pair: { code: 'payload_pair', type: 'uvec2', parameters: [] },
      });
    this.data = storage(device, parameters.bytes.byteLength);
    this.colors = storage(device, ColorPass.BYTES * file.count);
    this.layout = bufferLayout(
      device,
      ['read', 'read', 'read', 'read', 'read', 'read', 'write'],
      GPUShaderStage.COMPUTE,
    );
    this.buffers = bind(device, this.layout, [
      this.data,
      scene.geometry,
      scene.quads,
      scene.pairs,
      order.counts,
      order.order,
      this.colors,
    ]);
  }

  /** All texels are there: until now every Gaussian has its base colour. */
  complete(): void {
    const { scene } = this.scene;
    this.parameters.set({ num_residuals: scene.payload.length > 0 ? scene.numResiduals : 0 });
  }

  encode(encoder: GPUCommandEncoder, view: View, mode: Mode, precision: Precision): void {
    const { scene } = this.scene;
    const isByte = isInBytes(scene, precision);
    this.parameters.set(colorValues(scene, view, mode));
    this.device.queue.writeBuffer(this.data, 0, this.parameters.bytes);
    const pass = encoder.beginComputePass();
    pass.setPipeline(
      (this.pipelines[isByte ? 'byte' : 'half'] ??= computePipeline(
        this.device,
        this.layout,
        `const kEightBits = ${isByte};\n${this.code}`,
        'color_visible',
      )),
    );
    pass.setBindGroup(0, this.buffers);
    pass.dispatchWorkgroupsIndirect(this.order.counts, DepthOrder.COLOR_GROUPS);
    pass.end();
  }

  dispose(): void {
    this.data.destroy();
    this.colors.destroy();
  }
}
