// SPDX-License-Identifier: Apache-2.0
import { DataUtils, PerspectiveCamera, Vector3 } from 'three';
import { describe, expect, it } from 'vitest';
import { summarize } from '../src/benchmark';
import { CenterSample } from '../src/camera/extent';
import { cameraPose, defaultView } from '../src/camera/navigator';
import { camFromWorld, cropView, fitView, fovOf, withFov, type View } from '../src/camera/view';
import { parseScene } from '../src/format/reader';
import { dot, type Vector } from '../src/format/vector';
import { colorMix, gain } from '../src/render/photometric';
import { encode } from './encode';

const half = (x: number): number => DataUtils.toHalfFloat(x);

const VIEW: View = { right: [0, 0, -1], down: [0, -1, 0], forward: [-1, 0, 0], position: [3, 1, 2], fx: 100, fy: 110, cx: 40, cy: 30, width: 80, height: 50 };

/** Where a point of the world appears, as the vertex shader has it. */
function pixel(view: View, p: Vector): [number, number] {
  const { rotation: r, translation: t } = camFromWorld(view);
  const [x, y, z] = [0, 1, 2].map((i) => r[i] * p[0] + r[3 + i] * p[1] + r[6 + i] * p[2] + t[i]);
  return [(view.fx * x) / z + view.cx, (view.fy * y) / z + view.cy];
}

describe('views', () => {
  it('projects the axes of the camera', () => {
    expect(pixel(VIEW, [1, 1, 2])).toEqual([40, 30]); // two units ahead
    expect(pixel(VIEW, [1, 1, 1])).toEqual([90, 30]); // one to the right
    expect(pixel(VIEW, [1, 0, 2])).toEqual([40, 85]); // one down
  });

  it('fits another size: everything is scaled alike, and the middle stays the middle', () => {
    const fitted = fitView(VIEW, 320, 100);
    expect(pixel(fitted, [1, 1, 1])).toEqual([2 * 90 + 80, 60]);
    expect([fitted.width, fitted.height]).toEqual([320, 100]);
    expect(pixel(fitView(VIEW, 80, 50), [1, 0.5, 1.7])).toEqual(pixel(VIEW, [1, 0.5, 1.7]));
  });

  it('crops without scaling', () => {
    expect(pixel(cropView(VIEW, 1280, 720), [1, 0, 1])).toEqual(pixel(VIEW, [1, 0, 1]));
  });

  it('takes another field of view', () => {
    const wide = withFov(VIEW, 90);
    expect(fovOf(wide)).toBeCloseTo(90);
    expect(wide.fy).toBeCloseTo(25);
    expect(wide.fx / wide.fy).toBeCloseTo(VIEW.fx / VIEW.fy);
    expect(fovOf(withFov(VIEW, fovOf(VIEW)))).toBeCloseTo(fovOf(VIEW), 12);
  });

  it('reads the pose of a three.js camera', () => {
    const camera = new PerspectiveCamera();
    camera.up.set(0, -1, 0);
    camera.position.set(1, 2, 3);
    camera.lookAt(new Vector3(1, 2, 10));
    const { right, down, forward, position } = cameraPose(camera);
    for (const [got, wanted] of [[right, [1, 0, 0]], [down, [0, 1, 0]], [forward, [0, 0, 1]], [position, [1, 2, 3]]])
      got.forEach((v, i) => expect(v).toBeCloseTo(wanted[i], 12));
  });

  it('shows a scene without test views from its distance, level', () => {
    const view = defaultView(parseScene(encode({ testCameras: [] })));
    expect(Math.hypot(...view.position)).toBeCloseTo(3);
    expect(dot(view.right, [0, -1, 0])).toBeCloseTo(0);
    expect(view.down[1]).toBeCloseTo(1);
    expect(pixel(view, [0, 0, 0])[0]).toBeCloseTo(640);
  });
});

describe('the extent of a scene', () => {
  /** As packed geometry. */
  const texels = (centers: Vector[]) => Uint32Array.from(centers.flatMap(([x, y, z]) => [0, half(x) | (half(y) << 16), half(z), 0]));
  const ball = Array.from({ length: 1000 }, (_, i): Vector => {
    const z = 2 * ((i + 0.5) / 1000) - 1, angle = 2.4 * i, side = 2 * Math.sqrt(1 - z * z);
    return [5 + side * Math.cos(angle), side * Math.sin(angle), 2 * z];
  });

  it('holds all Gaussians of a ball, but not a stray one far away, nor what fills the last row', () => {
    const sample = new CenterSample(1001);
    sample.add(texels(ball.slice(0, 300)));
    sample.add(texels([...ball.slice(300), [1e4, 0, 0], [0, 0, 0]]));
    const { center, radius } = sample.extent();
    [5, 0, 0].forEach((x, i) => expect(center[i]).toBeCloseTo(x, 1));
    expect(radius).toBeGreaterThan(1.95);
    expect(radius).toBeLessThan(2.1);
  });

  it('needs no more than some of many', () => {
    const sample = new CenterSample(300_000);
    for (let i = 0; i < 300; ++i) sample.add(texels(ball));
    const { center, radius } = sample.extent();
    [5, 0, 0].forEach((x, i) => expect(center[i]).toBeCloseTo(x, 1));
    expect(radius).toBeCloseTo(2, 1);
  });

  it('is a sphere also without Gaussians', () => {
    expect(new CenterSample(0).extent()).toEqual({ center: [0, 0, 0], radius: 1 });
    const one = new CenterSample(1);
    one.add(texels([[1, 2, 3]]));
    expect(one.extent()).toEqual({ center: [1, 2, 3], radius: 0 });
  });
});

describe('photometric correction', () => {
  it('of zeros changes nothing', () => {
    colorMix(Array.from({ length: 8 }, () => 0)).forEach((v, i) => expect(v).toBeCloseTo(i % 4 ? 0 : 1, 12));
    expect(gain(0)).toBe(1);
  });

  it('moves the control points where the latents say', () => {
    const latents = [0.3, -0.2, 0.1, 0.4, -0.5, 0.2, 0.6, -0.1], m = colorMix(latents);
    const chromaticity = (rgb: number[]) => {
      const out = [0, 1, 2].map((i) => m[3 * i] * rgb[0] + m[3 * i + 1] * rgb[1] + m[3 * i + 2] * rgb[2]), sum = out[0] + out[1] + out[2];
      return [out[0] / sum, out[1] / sum];
    };
    const red = chromaticity([1, 0, 0]), neutral = chromaticity([1, 1, 1]);
    expect(red[0]).toBeCloseTo(1 + 0.058057 * 0.1 - 0.0179872 * 0.4, 10);
    expect(red[1]).toBeCloseTo(-0.0179872 * 0.1 + 0.0431061 * 0.4, 10);
    expect(neutral[0]).toBeCloseTo(1 / 3 + 0.0128369 * 0.6 + 0.0034654 * 0.1, 10);
  });

  it('keeps exposures within what is finite', () => {
    expect(gain(1e9)).toBe(2 ** 16);
    expect(gain(-1e9)).toBe(2 ** -16);
  });
});

it('summarizes times', () => {
  expect(summarize([4, 1, 3, 2])).toEqual({ mean: 2.5, median: 2.5, min: 1, max: 4 });
  expect(summarize([5])).toEqual({ mean: 5, median: 5, min: 5, max: 5 });
});
