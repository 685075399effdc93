// SPDX-License-Identifier: Apache-2.0
// Frame times by the paper's protocol: 1280x720, intrinsics of the test views in pixels, colours of the Gaussians and
// blending into 8 bits, each frame waited for; without photometric correction, and without sorting where that is not
// part of drawing a frame.

import { cropView, type View } from './camera/view';
import type { Scene } from './format/ngsplat';
import type { SceneRenderer } from './render/scene_renderer';

const WIDTH = 1280;
const HEIGHT = 720;

export interface Summary {
  mean: number;
  median: number;
  min: number;
  max: number;
}

export interface BenchmarkResult {
  protocol: string;
  way: SceneRenderer['way'];
  file: string;
  appearance: string;
  gaussians: number;
  width: number;
  height: number;
  framesPerView: number;
  /** Milliseconds, over the means of the views. `prepass` is the part that colours the Gaussians, measured alone. */
  frame: Summary;
  prepass: Summary;
  perView: { frame: number[]; prepass: number[] };
  renderer: string;
  userAgent: string;
}

export function summarize(values: number[]): Summary {
  const sorted = [...values].sort((a, b) => a - b);
  const n = sorted.length;
  const median = n % 2 ? sorted[(n - 1) / 2] : (sorted[n / 2 - 1] + sorted[n / 2]) / 2;
  return { mean: values.reduce((a, b) => a + b, 0) / n, median, min: sorted[0], max: sorted[n - 1] };
}

/**
 * `shown` is timed where there are no test views. `sort` brings the order up to date for a view. `progress` goes from 0
 * to 1. Throws where `signal` is aborted.
 */
export async function runBenchmark(
  renderer: SceneRenderer,
  scene: Scene,
  shown: View,
  file: string,
  sort: (view: View) => Promise<void>,
  framesPerView: number,
  progress: (part: number) => void,
  signal: AbortSignal,
): Promise<BenchmarkResult> {
  const views = (scene.testCameras.length ? scene.testCameras : [shown]).map((view) => cropView(view, WIDTH, HEIGHT));
  /** Mean of so many in a row; one before is not timed. */
  const time = async (draw: () => Promise<void>) => {
    await draw();
    const begin = performance.now();
    for (let i = 0; i < framesPerView; ++i) await draw();
    return (performance.now() - begin) / framesPerView;
  };

  for (const view of views) {
    await sort(view);
    await renderer.timeFrame(view);
    signal.throwIfAborted();
  }
  const perView = { frame: [] as number[], prepass: [] as number[] };
  for (const [i, view] of views.entries()) {
    await sort(view);
    perView.frame.push(await time(() => renderer.timeFrame(view)));
    perView.prepass.push(await time(() => renderer.timeColors(view)));
    progress((i + 1) / views.length);
    await new Promise((resolve) => setTimeout(resolve)); // lets the page answer
    signal.throwIfAborted();
  }
  return {
    protocol: renderer.benchmarkProtocol,
    way: renderer.way,
    file,
    appearance: scene.model.packing.name,
    gaussians: scene.count,
    width: WIDTH,
    height: HEIGHT,
    framesPerView,
    frame: summarize(perView.frame),
    prepass: summarize(perView.prepass),
    perView,
    renderer: renderer.deviceName,
    userAgent: navigator.userAgent,
  };
}
