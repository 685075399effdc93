// SPDX-License-Identifier: Apache-2.0
// Gaussians that a view may show, by depth, farthest first, sorted on the device. How many they are is known there
// alone.

import type { View } from '../camera/view';
import { extent, FAR_PLANE, MOST_DEVIATIONS, NEAR_PLANE } from '../sort/sort';
import gaussianCode from '../render/gaussian.glsl?raw';
import { bind, bufferLayout, computePipeline, storage } from './kernel';
import countsCode from './counts.wgsl?raw';
import cullCode from './cull.wgsl?raw';
import { Parameters } from './parameters';
import radixCode from './radix.wgsl?raw';
import scanCode from './scan.wgsl?raw';
import { translate } from './translate';

/** Gaussians of a workgroup (kBlock in the shaders), digits of a pass, and the passes for keys of 24 bits. */
const BLOCK = 4096;
const DIGITS = 256;
const SHIFTS = [0, 8, 16];

const COUNTS_BYTES = 48;
const COUNTS_AT = { sortGroups: 16, visible: 28, colorGroups: 32 };

interface Sort {
  pipelines: GPUComputePipeline[];
  buffers: GPUBindGroup;
}

export class DepthOrder {
  /**
   * The buffer `Counts` of the shaders. It begins with the arguments of the indirect draw; those of the dispatch over
   * visible Gaussians stand at COLOR_GROUPS.
   */
  readonly counts: GPUBuffer;
  /** Of a Gaussian. */
  static readonly BYTES = 16;
  static readonly COLOR_GROUPS = COUNTS_AT.colorGroups;
  static readonly VISIBLE = COUNTS_AT.visible;
  /** The sorted indices. */
  readonly order: GPUBuffer;
  private readonly buffers: GPUBuffer[];
  private readonly numBlocks: number;
  private readonly parameters = new Parameters({
    right: 'vec3',
    down: 'vec3',
    forward: 'vec3',
    position: 'vec3',
    low: 'vec2',
    high: 'vec2',
    reach: 'vec2',
    near_plane: 'float',
    far_plane: 'float',
    deviations: 'float',
    count: 'uint',
  });
  private readonly view: GPUBuffer;
  private readonly cull: Record<'count' | 'place' | 'write', GPUComputePipeline>;
  private readonly culled: GPUBindGroup;
  private readonly sorts: Sort[];

  constructor(
    private readonly device: GPUDevice,
    geometry: GPUBuffer,
    count: number,
  ) {
    this.numBlocks = Math.ceil(count / BLOCK);
    const [view, counts, blocks, places, digits] = [
      this.parameters.bytes.byteLength,
      COUNTS_BYTES,
      4 * this.numBlocks,
      4 * DIGITS * this.numBlocks,
      4 * DIGITS,
    ].map((bytes) => storage(device, bytes, GPUBufferUsage.INDIRECT | GPUBufferUsage.COPY_SRC));
    const list = () => storage(device, 4 * count, GPUBufferUsage.COPY_SRC);
    const keys = [list(), list()];
    const indices = [list(), list()];
    this.buffers = [view, counts, blocks, places, digits, ...keys, ...indices];
    this.view = view;
    this.counts = counts;
    this.order = indices[SHIFTS.length % 2];
    this.parameters.set({ near_plane: NEAR_PLANE, far_plane: FAR_PLANE, deviations: MOST_DEVIATIONS, count });

    const cullLayout = bufferLayout(
      device,
      ['read', 'read', 'write', 'write', 'write', 'write'],
      GPUShaderStage.COMPUTE,
    );
    const code = scanCode + translate(gaussianCode, {}) + countsCode + this.parameters.declaration('View') + cullCode;
    const pipeline = (entry: string) => computePipeline(device, cullLayout, code, entry);
    this.cull = { count: pipeline('count_visible'), place: pipeline('place_blocks'), write: pipeline('write_visible') };
    this.culled = bind(device, cullLayout, [view, geometry, blocks, counts, keys[0], indices[0]]);

    const sortLayout = bufferLayout(
      device,
      ['read', 'read', 'read', 'write', 'write', 'write', 'write'],
      GPUShaderStage.COMPUTE,
    );
    this.sorts = SHIFTS.map((shift, i) => {
      const from = i % 2;
      const to = 1 - from;
      return {
        pipelines: ['count_digits', 'place_digits', 'move_keys'].map((entry) =>
          computePipeline(device, sortLayout, scanCode + countsCode + radixCode, entry, { shift }),
        ),
        buffers: bind(device, sortLayout, [counts, keys[from], indices[from], keys[to], indices[to], places, digits]),
      };
    });
  }

  /** Adds to `encoder` what brings the order up to date for a view, with scales `size` times as large. */
  encode(encoder: GPUCommandEncoder, view: View, size: number): void {
    const across = extent(view.fx, view.cx, view.width, 0);
    const along = extent(view.fy, view.cy, view.height, 0);
    this.parameters.set({
      right: view.right,
      down: view.down,
      forward: view.forward,
      position: view.position,
      low: [across.low, along.low],
      high: [across.high, along.high],
      reach: [size * across.reach, size * along.reach],
    });
    this.device.queue.writeBuffer(this.view, 0, this.parameters.bytes);
    const pass = encoder.beginComputePass();
    pass.setBindGroup(0, this.culled);
    for (const [pipeline, groups] of [
      [this.cull.count, this.numBlocks],
      [this.cull.place, 1],
      [this.cull.write, this.numBlocks],
    ] as const) {
      pass.setPipeline(pipeline);
      pass.dispatchWorkgroups(groups);
    }
    for (const {
      pipelines: [count, place, move],
      buffers,
    } of this.sorts) {
      pass.setBindGroup(0, buffers);
      pass.setPipeline(count);
      pass.dispatchWorkgroupsIndirect(this.counts, COUNTS_AT.sortGroups);
      pass.setPipeline(place);
      pass.dispatchWorkgroups(DIGITS);
      pass.setPipeline(move);
      pass.dispatchWorkgroupsIndirect(this.counts, COUNTS_AT.sortGroups);
    }
    pass.end();
  }

  dispose(): void {
    for (const buffer of this.buffers) buffer.destroy();
  }
}
