// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { keyframePath, pathFrames, turntable } from '../src/camera/path';
import { formatCameras, formatNerfstudio, parsePath } from '../src/camera/path_files';
import { fovOf, type View } from '../src/camera/view';
import { dot, type Vector } from '../src/format/vector';

/** At the angle from +z around -y (which is up), looking at the axis. */
function around(angle: number, distance = 3, height = 0): View {
  const s = Math.sin(angle);
  const c = Math.cos(angle);
  return {
    right: [-c, 0, s],
    down: [0, 1, 0],
    forward: [-s, 0, -c],
    position: [distance * s, height, distance * c],
    fx: 90,
    fy: 100,
    cx: 40,
    cy: 30,
    width: 80,
    height: 60,
  };
}

const VIEWS = [around(0), around(1, 3, 1), around(2, 4, -1), around(3)];

function expectVector(got: Vector, wanted: Vector, digits = 9): void {
  wanted.forEach((x, i) => expect(got[i]).toBeCloseTo(x, digits));
}

function expectPose(got: View, wanted: View, digits = 9): void {
  for (const key of ['right', 'down', 'forward', 'position'] as const) expectVector(got[key], wanted[key], digits);
}

describe('a path through keyframes', () => {
  it('meets each, as long apart', () => {
    const path = keyframePath(VIEWS);
    VIEWS.forEach((view, i) => expectPose(path(i / 3), view));
  });

  it('turns evenly and keeps its axes perpendicular', () => {
    const path = keyframePath([around(0), around(1)]);
    const middle = path(0.25);
    expectVector(middle.forward, around(0.25).forward);
    expect(dot(middle.right, middle.forward)).toBeCloseTo(0, 12);
    expect(middle).toMatchObject({ width: 80, height: 60, cx: 40, cy: 30 });
  });

  it('has no kinks: its direction is the same before and behind a keyframe', () => {
    const path = keyframePath(VIEWS);
    const e = 1e-5;
    const at = (t: number) => path(t).position;
    for (const t of [1 / 3, 2 / 3]) {
      const before = at(t).map((x, i) => x - at(t - e)[i]) as Vector;
      const after = at(t + e).map((x, i) => x - at(t)[i]) as Vector;
      expect(dot(before, after) / Math.hypot(...before) / Math.hypot(...after)).toBeGreaterThan(0.99999);
    }
  });

  it('is not along straight lines', () => {
    const p = keyframePath(VIEWS)(0.5).position;
    const line = VIEWS[1].position.map((x, i) => (x + VIEWS[2].position[i]) / 2);
    expect(Math.hypot(...p.map((x, i) => x - line[i]))).toBeGreaterThan(0.1);
  });

  it('zooms between lenses', () => {
    const path = keyframePath([VIEWS[0], { ...VIEWS[1], fy: 400, fx: 400, width: 160, height: 120 }]);
    expect(path(1)).toMatchObject({ fy: 200, fx: 200, width: 80, height: 60 });
    expect(path(0.5).fy).toBeCloseTo(150);
  });

  it('stays where there is one keyframe, or one twice', () => {
    expectPose(keyframePath([VIEWS[1]])(0.7), VIEWS[1]);
    expectPose(keyframePath([VIEWS[1], VIEWS[1]])(0.7), VIEWS[1]);
  });

  it('has a picture at every keyframe', () => {
    const frames = pathFrames(VIEWS, 30);
    expect(frames.length).toBe(31);
    expect(frames.flatMap(({ keyframe }, i) => (keyframe ? [i] : []))).toEqual([0, 10, 20, 30]);
    expect(pathFrames(VIEWS, 1).length).toBe(4);
    expect(pathFrames([VIEWS[0]], 30)).toEqual([{ view: VIEWS[0], keyframe: true }]);
  });
});

it('a turntable goes around and comes back, looking at the centre', () => {
  const view = around(0.3, 3, -1);
  const path = turntable(view, [0, -1, 0], [0, -2, 0]);
  expectPose(path(0), view);
  expectPose(path(1), view);
  expectVector(path(0.5).position, around(0.3 + Math.PI, 3, -1).position);
  for (const t of [0.1, 0.4, 0.8])
    expect(dot(path(t).forward, [path(t).position[0] / -3, 0, path(t).position[2] / -3])).toBeCloseTo(1);
});

const FRAME = { center: [100, 200, 300] as Vector, scale: 0.5 };

describe('a path as a list of cameras', () => {
  it('is what gsapp render --path reads', () => {
    const [entry] = JSON.parse(formatCameras([{ view: around(0), keyframe: true }]));
    // From camera to world by rows: the camera at z = 3 looks along -z, its right is -x, its down is y.
    expect(entry).toEqual({
      id: 0,
      img_name: 'path/0000',
      width: 80,
      height: 60,
      position: [0, 0, 3],
      rotation: [
        [-1, 0, 0],
        [0, 1, 0],
        [0, 0, -1],
      ],
      fy: 100,
      fx: 90,
      keyframe: true,
    });
  });

  it('comes back, keyframes alone', () => {
    const { keyframes, seconds } = parsePath(formatCameras(pathFrames(VIEWS, 40)));
    expect(keyframes.length).toBe(4);
    keyframes.forEach((view, i) => expectPose(view, VIEWS[i]));
    expect(keyframes[1]).toMatchObject({ fx: 90, fy: 100, width: 80, height: 60 });
    expect(seconds).toBeUndefined();
  });

  it('is in the coordinates of the scene', () => {
    const text = formatCameras([{ view: around(0), keyframe: true }], FRAME);
    expect(JSON.parse(text)[0].position).toEqual([100, 200, 306]);
    expectPose(parsePath(text, FRAME).keyframes[0], around(0));
  });

  it('reads cameras.json of gsapp: every camera, an offset, one focal length', () => {
    const camera = {
      id: 0,
      img_name: 'a',
      width: 80,
      height: 60,
      position: [0, 0, 1],
      rotation: [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
      ],
      fy: 70,
    };
    const { keyframes } = parsePath(JSON.stringify([camera, { ...camera, offset: [1, 2, 3], fx: 50 }]));
    expect(keyframes.map(({ position, fx }) => [position, fx])).toEqual([
      [[0, 0, 1], 70],
      [[1, 2, 4], 50],
    ]);
  });
});

describe("a path as nerfstudio's", () => {
  it('has OpenGL axes, the vertical field of view and the size', () => {
    const json = JSON.parse(
      formatNerfstudio(
        [
          { view: around(0), keyframe: true },
          { view: around(1), keyframe: true },
        ],
        4,
      ),
    );
    expect(json).toMatchObject({
      camera_type: 'perspective',
      render_height: 60,
      render_width: 80,
      seconds: 4,
      fps: 0.5,
    });
    // Right -x, up -y, back z: the columns.
    expect(json.camera_path[0].camera_to_world).toEqual(
      [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 3, 0, 0, 0, 1].map((x) => expect.closeTo(x, 12)),
    );
    expect(json.camera_path[0].fov).toBeCloseTo((360 / Math.PI) * Math.atan(0.3));
    expect(json.camera_path[0].aspect).toBeCloseTo(80 / 60);
  });

  it('comes back', () => {
    const { keyframes, seconds } = parsePath(formatNerfstudio(pathFrames(VIEWS, 40), 6, FRAME), FRAME);
    expect(keyframes.length).toBe(4);
    keyframes.forEach((view, i) => expectPose(view, VIEWS[i], 8));
    expect(fovOf(keyframes[2])).toBeCloseTo(fovOf(VIEWS[2]));
    expect(seconds).toBe(6);
  });
});

it('says what is wrong with a path', () => {
  const camera = {
    width: 80,
    height: 60,
    position: [0, 0, 1],
    rotation: [
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ],
    fy: 70,
  };
  const path = {
    camera_type: 'perspective',
    render_width: 80,
    render_height: 60,
    camera_path: [{ camera_to_world: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], fov: 50 }],
  };
  parsePath(JSON.stringify([camera]));
  parsePath(JSON.stringify(path));
  const wrong: [unknown, RegExp][] = [
    [[], /no list/],
    [{}, /no list/],
    [null, /no list/],
    [3, /no list/],
    [[null], /camera 1: width/],
    [[camera, { ...camera, fy: -1 }], /camera 2: fy is -1/],
    [[{ ...camera, width: 1.5 }], /width is 1.5/],
    [[{ ...camera, position: [1, 2] }], /position is not 3 numbers/],
    [
      [
        {
          ...camera,
          rotation: [
            [2, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
          ],
        },
      ],
      /rotation is none/,
    ],
    [
      [
        {
          ...camera,
          rotation: [
            [-1, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
          ],
        },
      ],
      /rotation is none/,
    ],
    [[{ ...camera, rotation: 5 }], /three rows/],
    [[{ ...camera, offset: 'x' }], /offset/],
    [{ ...path, camera_type: 'fisheye' }, /"fisheye"/],
    [{ ...path, render_width: 0 }, /render_width is 0/],
    [{ ...path, camera_path: [{ camera_to_world: [1], fov: 50 }] }, /16 numbers/],
    [{ ...path, camera_path: [{ ...path.camera_path[0], fov: 180 }] }, /fov is 180/],
  ];
  for (const [json, words] of wrong) expect(() => parsePath(JSON.stringify(json)), JSON.stringify(json)).toThrow(words);
  expect(() => parsePath('{')).toThrow(/not JSON/);
});
