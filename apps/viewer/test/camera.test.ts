// SPDX-License-Identifier: Apache-2.0
import { DataUtils, PerspectiveCamera, Vector3 } from 'three';
import { describe, expect, it } from 'vitest';
import { summarize } from '../src/benchmark';
import { focusOf, ModelSample } from '../src/camera/extent';
import { axisOf, cameraPose, frontOf, lookDown, rollOf } from '../src/camera/navigator';
import { camFromWorld, cropView, fitView, fovOf, withFov, type View } from '../src/camera/view';
import { dot, type Vector } from '../src/format/vector';
import { colorMix, gain } from '../src/render/photometric';

const half = (x: number): number => DataUtils.toHalfFloat(x);

const VIEW: View = {
  right: [0, 0, -1],
  down: [0, -1, 0],
  forward: [-1, 0, 0],
  position: [3, 1, 2],
  fx: 100,
  fy: 110,
  cx: 40,
  cy: 30,
  width: 80,
  height: 50,
};

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
    for (const [got, wanted] of [
      [right, [1, 0, 0]],
      [down, [0, 1, 0]],
      [forward, [0, 0, 1]],
      [position, [1, 2, 3]],
    ])
      got.forEach((v, i) => expect(v).toBeCloseTo(wanted[i], 12));
  });

  it('measures the roll of a view, unless it looks up or down', () => {
    const level: View = { ...VIEW, right: [1, 0, 0], down: [0, 1, 0], forward: [0, 0, 1] };
    expect(rollOf(level, [0, -1, 0])).toBeCloseTo(0);
    expect(Math.abs(rollOf(level, [0, 1, 0]))).toBeCloseTo(180);
    expect(Math.abs(rollOf(level, [1, 0, 0]))).toBeCloseTo(90);
    expect(Math.abs(rollOf(level, [0.5, -0.5 * Math.sqrt(3), 7]))).toBe(0);
    expect(Math.abs(rollOf(level, [0.5, -0.5 * Math.sqrt(3), 0.2]))).toBeCloseTo(30);
  });

  it('knows the front of a model by the axis that is up, level also where the axis is not quite one', () => {
    const fronts: [string, Vector][] = [
      ['y', [0, 0, 1]],
      ['-y', [0, 0, -1]],
      ['z', [0, -1, 0]],
      ['-z', [0, 1, 0]],
      ['x', [0, 0, 1]],
      ['-x', [0, 0, 1]],
    ];
    for (const [up, front] of fronts) frontOf(axisOf(up as 'x')).forEach((x, i) => expect(x, up).toBeCloseTo(front[i]));
    expect(dot(frontOf([0.1, -0.9, 0.3]), [0.1, -0.9, 0.3])).toBeCloseTo(0);
  });

  it('looks down by an angle without turning aside', () => {
    lookDown([0, 0.3, 2], [0, 1, 0], 30).forEach((x, i) => expect(x).toBeCloseTo([0, -0.5, Math.sqrt(0.75)][i]));
    expect(lookDown([0, -1, 0], [0, 1, 0], 30)[1]).toBeCloseTo(-0.5);
  });
});

describe('the extent of a model', () => {
  /** As packed geometry: opaque Gaussians, by the code of their three scales. */
  const texels = (centers: Vector[], scale = 0) =>
    Uint32Array.from(
      centers.flatMap(([x, y, z]) => [0xff000000, half(x) | (half(y) << 16), half(z), scale * 0x010101]),
    );
  const ball = (count: number, [x, y, z]: Vector, radius: number) =>
    Array.from({ length: count }, (_, i): Vector => {
      const height = 2 * ((i + 0.5) / count) - 1;
      const angle = 2.4 * i;
      const side = Math.sqrt(1 - height * height);
      return [x + radius * side * Math.cos(angle), y + radius * side * Math.sin(angle), z + radius * height];
    });
  const looking = (position: Vector, to: Vector): View => {
    const camera = new PerspectiveCamera();
    camera.up.set(0, 0, 1);
    camera.position.set(...position);
    camera.lookAt(new Vector3(...to));
    return { ...cameraPose(camera), fx: 100, fy: 100, cx: 50, cy: 50, width: 100, height: 100 };
  };
  const around = (count: number, [x, y, z]: Vector, radius: number) =>
    Array.from({ length: count }, (_, i) =>
      looking([x + radius * Math.cos(i), y + radius * Math.sin(i), z + 1], [x, y, z]),
    );
  const extentOf = (centers: Vector[], cameras: View[] = []) => {
    const sample = new ModelSample(centers.length, cameras);
    sample.add(texels(centers));
    return sample.extent();
  };
  const near = (
    { center, radius }: { center: Vector; radius: number },
    wanted: Vector,
    least: number,
    most: number,
  ) => {
    center.forEach((x, i) => expect(x).toBeCloseTo(wanted[i], 0.7));
    expect(radius).toBeGreaterThan(least);
    expect(radius).toBeLessThan(most);
  };

  it('holds all Gaussians of a ball, but not a stray one far away, nor what fills the last row', () => {
    const sample = new ModelSample(1001);
    const all = ball(1000, [5, 0, 0], 2);
    sample.add(texels(all.slice(0, 300)));
    sample.add(texels([...all.slice(300), [1e4, 0, 0], [0, 0, 0]]));
    near(sample.extent(), [5, 0, 0], 1.95, 2.1);
  });

  it('leaves out what is far away, be it one of a hundred or one of three', () => {
    for (const far of [10, 500])
      near(extentOf([...ball(1000, [5, 0, 0], 2), ...ball(far, [0, 0, 0], 300)]), [5, 0, 0], 1.9, 2.2);
  });

  it('holds surroundings that have enough Gaussians', () => {
    near(extentOf([...ball(300, [0, 0, 0], 1), ...ball(1000, [0, 0, 0], 5)]), [0, 0, 0], 4.9, 5.2);
  });

  it('is around what cameras look at and not beyond them, whatever lies behind', () => {
    const centers = [...ball(300, [5, 0, 0], 1), ...ball(3000, [-20, 0, 0], 60)];
    near(extentOf(centers, around(20, [5, 0, 0], 3)), [5, 0, 0], 2.9, 3.3);
    near(extentOf(ball(300, [5, 0, 0], 1), around(20, [5, 0, 0], 3)), [5, 0, 0], 0.9, 1.1);
  });

  it('does not hold what no camera sees', () => {
    const cameras = [looking([0, 0, 0], [1, 0, 0]), looking([0, 0.1, 0], [1, 0.1, 0])];
    near(extentOf([...ball(500, [10, 0, 0], 1), ...ball(600, [-8, 0, 0], 1)], cameras), [10, 0, 0], 0.9, 1.1);
  });

  it('needs no more than some of many', () => {
    const sample = new ModelSample(300_000);
    const part = texels(ball(1000, [5, 0, 0], 2));
    for (let i = 0; i < 300; ++i) sample.add(part);
    near(sample.extent(), [5, 0, 0], 1.9, 2.1);
  });

  it('is a sphere also without Gaussians, and of one', () => {
    expect(new ModelSample(0).extent()).toEqual({ center: [0, 0, 0], radius: 1 });
    expect(extentOf([[1, 2, 3]])).toEqual({ center: [1, 2, 3], radius: 0 });
    const large = new ModelSample(1);
    large.add(texels([[1, 2, 3]], 1 + Math.round((12 * 254) / 21))); // a standard deviation of 1
    expect(large.extent().radius).toBeCloseTo(2, 1);
  });

  it('has a focus where cameras look at one thing, also if some look elsewhere', () => {
    const cameras = [...around(20, [1, 2, 3], 4), looking([5, 2, 3], [9, 9, 9]), looking([5, 2, 3], [9, -9, 3])];
    focusOf(cameras)!.forEach((x, i) => expect(x).toBeCloseTo([1, 2, 3][i], 1));
    expect(focusOf(Array.from({ length: 9 }, (_, i) => looking([i, 0, 0], [i, 1, 0])))).toBeUndefined();
    expect(
      focusOf(
        Array.from({ length: 9 }, (_, i) =>
          looking([Math.cos(i), Math.sin(i), 0], [3 * Math.cos(i), 3 * Math.sin(i), 0]),
        ),
      ),
    ).toBeUndefined();
  });

  it('knows what a picture is covered by, in front of a depth', () => {
    const wall = new ModelSample(10_000);
    const camera = looking([0, 0, 0], [0, 1, 0]);
    wall.add(
      texels(
        Array.from({ length: 10_000 }, (_, i): Vector => [((i % 100) - 50) / 20, 4, (Math.floor(i / 100) - 50) / 20]),
        1 + Math.round((9 * 254) / 21),
      ),
    );
    expect(wall.covered(camera, 5)).toBeGreaterThan(0.7);
    expect(wall.covered(camera, 3)).toBe(0);
    expect(wall.covered(looking([0, 0, 0], [0, -1, 0]), 5)).toBe(0);
  });
});

describe('photometric correction', () => {
  it('of zeros changes nothing', () => {
    colorMix(Array.from({ length: 8 }, () => 0)).forEach((v, i) => expect(v).toBeCloseTo(i % 4 ? 0 : 1, 12));
    expect(gain(0)).toBe(1);
  });

  it('moves the control points where the latents say', () => {
    const latents = [0.3, -0.2, 0.1, 0.4, -0.5, 0.2, 0.6, -0.1];
    const m = colorMix(latents);
    const chromaticity = (rgb: number[]) => {
      const out = [0, 1, 2].map((i) => m[3 * i] * rgb[0] + m[3 * i + 1] * rgb[1] + m[3 * i + 2] * rgb[2]);
      const sum = out[0] + out[1] + out[2];
      return [out[0] / sum, out[1] / sum];
    };
    const red = chromaticity([1, 0, 0]);
    const neutral = chromaticity([1, 1, 1]);
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
