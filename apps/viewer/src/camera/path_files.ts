// SPDX-License-Identifier: Apache-2.0
// Camera paths as files: the list of cameras that `gsapp render --path` reads (as cameras.json of 3DGS), and
// nerfstudio's camera_path.json. Both hold every picture of the path. An own key, `keyframe`, marks those that the
// others lie between.

import type { Frame } from '../format/trailer';
import { dot, type Vector } from '../format/vector';
import type { PathFrame } from './path';
import { fovOf, type View } from './view';

/** What is wrong with a file, for people. */
export class PathError extends Error {}

const MOST_PIXELS = 65535;
/** What `gsapp render` asks of a rotation, too. */
const ROTATION_TOLERANCE = 1e-3;

type Json = Record<string, unknown>;

const toScene = ({ center, scale }: Frame, p: Vector): Vector => p.map((x, i) => x / scale + center[i]) as Vector;
const fromScene = ({ center, scale }: Frame, p: Vector): Vector => p.map((x, i) => scale * (x - center[i])) as Vector;
const IDENTITY: Frame = { center: [0, 0, 0], scale: 1 };

/** The list that `gsapp render --path` reads. `frame` is that of the model; files have the scene's own coordinates. */
export function formatCameras(frames: readonly PathFrame[], frame = IDENTITY): string {
  const list = frames.map(({ view, keyframe }, id) => ({
    id,
    img_name: `path/${String(id).padStart(4, '0')}`,
    width: view.width,
    height: view.height,
    position: toScene(frame, view.position),
    rotation: [0, 1, 2].map((row) => [view.right[row], view.down[row], view.forward[row]]),
    fy: view.fy,
    fx: view.fx,
    keyframe,
  }));
  return `${JSON.stringify(list, null, 1)}\n`;
}

/** Nerfstudio's path, in which cameras look along -z with y up. */
export function formatNerfstudio(frames: readonly PathFrame[], seconds: number, frame = IDENTITY): string {
  const { width, height } = frames[0].view;
  const path = frames.map(({ view, keyframe }) => {
    const position = toScene(frame, view.position);
    const rows = [0, 1, 2].map((row) => [view.right[row], -view.down[row], -view.forward[row], position[row]]);
    return { camera_to_world: [...rows.flat(), 0, 0, 0, 1], fov: fovOf(view), aspect: width / height, keyframe };
  });
  return `${JSON.stringify({ camera_type: 'perspective', render_height: height, render_width: width, fps: frames.length / seconds, seconds, camera_path: path }, null, 1)}\n`;
}

function numbers(value: unknown, count: number, what: string): number[] {
  if (!Array.isArray(value) || value.length !== count || !value.every(Number.isFinite))
    throw new PathError(`${what} is not ${count} numbers`);
  return value as number[];
}

function within(value: unknown, least: number, most: number, what: string): number {
  if (!(typeof value === 'number' && value > least && value <= most))
    throw new PathError(`${what} is ${JSON.stringify(value)}`);
  return value;
}

function pixels(value: unknown, what: string): number {
  const n = within(value, 0, MOST_PIXELS, what);
  if (!Number.isInteger(n)) throw new PathError(`${what} is ${n}`);
  return n;
}

/** Views with their axes given as columns. */
function checkedAxes(
  right: Vector,
  down: Vector,
  forward: Vector,
  where: string,
): Pick<View, 'right' | 'down' | 'forward'> {
  const all = [right, down, forward];
  const isRotation = all.every((a, i) =>
    all.every((b, j) => Math.abs(dot(a, b) - Number(i === j)) <= ROTATION_TOLERANCE),
  );
  const turned =
    right[0] * (down[1] * forward[2] - down[2] * forward[1]) +
    right[1] * (down[2] * forward[0] - down[0] * forward[2]) +
    right[2] * (down[0] * forward[1] - down[1] * forward[0]);
  if (!isRotation || turned < 0) throw new PathError(`${where}: its rotation is none`);
  return { right, down, forward };
}

function readCamera(entry: Json, where: string, frame: Frame): View {
  const width = pixels(entry.width, `${where}: width`);
  const height = pixels(entry.height, `${where}: height`);
  const fy = within(entry.fy, 0, 1e6, `${where}: fy`);
  const fx = entry.fx === undefined ? fy : within(entry.fx, 0, 1e6, `${where}: fx`);
  const offset = entry.offset === undefined ? [0, 0, 0] : numbers(entry.offset, 3, `${where}: offset`);
  const position = numbers(entry.position, 3, `${where}: position`).map((x, i) => x + offset[i]) as Vector;
  if (!Array.isArray(entry.rotation) || entry.rotation.length !== 3)
    throw new PathError(`${where}: rotation is not three rows`);
  const rows = entry.rotation.map((row) => numbers(row, 3, `${where}: a row of rotation`));
  const column = (k: number) => rows.map((row) => row[k]) as Vector;
  return {
    ...checkedAxes(column(0), column(1), column(2), where),
    position: fromScene(frame, position),
    fx,
    fy,
    cx: width / 2,
    cy: height / 2,
    width,
    height,
  };
}

function readNerfstudioCamera(entry: Json, where: string, width: number, height: number, frame: Frame): View {
  const m = numbers(entry.camera_to_world, 16, `${where}: camera_to_world`);
  const fov = within(entry.fov, 0, 179, `${where}: fov`);
  const column = (k: number, sign: number) => [0, 1, 2].map((row) => sign * m[4 * row + k]) as Vector;
  const fy = height / 2 / Math.tan((fov * Math.PI) / 360);
  return {
    ...checkedAxes(column(0, 1), column(1, -1), column(2, -1), where),
    position: fromScene(frame, column(3, 1)),
    fx: fy,
    fy,
    cx: width / 2,
    cy: height / 2,
    width,
    height,
  };
}

/**
 * The keyframes of a file of either form, or all its cameras where none is marked, and its length where it says so.
 * Throws PathError.
 */
export function parsePath(text: string, frame = IDENTITY): { keyframes: View[]; seconds?: number } {
  let json: unknown;
  try {
    json = JSON.parse(text);
  } catch {
    throw new PathError('it is not JSON');
  }
  const nerfstudio = Array.isArray(json) ? undefined : (json as Json | null);
  const list = nerfstudio ? nerfstudio.camera_path : json;
  if (!Array.isArray(list) || list.length === 0) throw new PathError('it holds no list of cameras');
  const entries = list.map((entry) => (entry ?? {}) as Json);
  let read: (entry: Json, where: string) => View = (entry, where) => readCamera(entry, where, frame);
  if (nerfstudio) {
    if ((nerfstudio.camera_type ?? 'perspective') !== 'perspective')
      throw new PathError(`its cameras are ${JSON.stringify(nerfstudio.camera_type)}, not perspective`);
    const width = pixels(nerfstudio.render_width, 'render_width');
    const height = pixels(nerfstudio.render_height, 'render_height');
    read = (entry, where) => readNerfstudioCamera(entry, where, width, height, frame);
  }
  const views = entries.map((entry, i) => read(entry, `camera ${i + 1}`));
  const marked = views.filter((_, i) => entries[i].keyframe === true);
  const seconds = Number(nerfstudio?.seconds);
  return {
    keyframes: marked.length > 0 ? marked : views,
    seconds: seconds > 0 && Number.isFinite(seconds) ? seconds : undefined,
  };
}
