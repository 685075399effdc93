// SPDX-License-Identifier: Apache-2.0
// Reads .ply files of Gaussians as 3DGS and most programs after it write them, and of coloured points. Columns go by
// their names.

import { FormatError } from './cursor';
import {
  BASE,
  MEAN,
  MOST_DEGREE,
  OPACITY,
  REST,
  ROTATION,
  SCALE,
  Y0,
  restWidth,
  rowWidth,
  type GaussianSource,
} from './gaussian_source';
import { ColorActivation } from './ngsplat';
import type { Vector } from './vector';
import { readPlyHeader, type PlyElement, type PlyHeader, type PlyProperty } from './ply_header';

const indexed = (prefix: string, count: number): string[] => Array.from({ length: count }, (_, k) => `${prefix}_${k}`);

/** Columns in the order of a row. */
const POSITION = ['x', 'y', 'z'];
const GEOMETRY = [...indexed('scale', 3), ...indexed('rot', 4), 'opacity'];
const DC = indexed('f_dc', 3);
const RGB = ['red', 'green', 'blue'];
const APP_BASE = indexed('app_base', 3);
const LARGEST_CODE: Record<string, number> = { uchar: 255, uint8: 255, ushort: 65535, uint16: 65535 };
/** Colours that are no floating-point numbers go up to the largest of their type. */
const colorFactor = ({ type }: PlyProperty): number => 1 / (LARGEST_CODE[type] ?? 1);
const ACTIVATIONS: Record<string, ColorActivation> = {
  relu: ColorActivation.Relu,
  softplus: ColorActivation.Softplus,
  sigmoid: ColorActivation.Sigmoid,
  hardsigmoid: ColorActivation.HardSigmoid,
};
/** Models of gsapp that f_dc and f_rest hold completely. */
const PLAIN_MODELS = ['sh', 'none'];

/** Copies a row's numbers of some columns to `out`, from `at` on. */
type Copy = (row: number, out: Float64Array, at: number) => void;

/** The rows of one element. */
class Rows {
  private readonly view: DataView;

  constructor(
    buffer: ArrayBuffer,
    private readonly header: PlyHeader,
    readonly element: PlyElement,
  ) {
    let begin = header.bytes;
    for (const before of header.elements) {
      if (before === element) break;
      if (before.hasLists)
        throw new FormatError(
          `its element ${before.name.slice(0, 80)}, in front of the vertices, has lists, which the viewer does not read`,
        );
      begin += before.count * before.stride;
    }
    const bytes = element.count * element.stride;
    const rest = buffer.byteLength - begin;
    if (!(bytes <= rest))
      throw new FormatError(
        `the file is truncated: ${element.count} vertices take ${bytes} bytes, but only ${Math.max(rest, 0)} follow`,
      );
    this.view = new DataView(buffer, begin, bytes);
  }

  copier(columns: PlyProperty[]): Copy {
    const {
      view,
      header: { littleEndian },
      element: { stride },
    } = this;
    if (columns.some(({ type }) => type !== 'float' && type !== 'float32')) {
      return (row, out, at) =>
        columns.forEach(({ offset, read }, k) => (out[at + k] = read(view, row * stride + offset, littleEndian)));
    }
    // what almost all files have, and several times as fast
    const offsets = Float64Array.from(columns, ({ offset }) => offset);
    return (row, out, at) => {
      for (let k = 0; k < offsets.length; ++k) out[at + k] = view.getFloat32(row * stride + offsets[k], littleEndian);
    };
  }
}

/** What gsapp says of the model: docs/formats.md. */
function gsappComment(comments: string[]): { model: string; activation: string } | undefined {
  for (const comment of comments) {
    const match = /^gsapp appearance (\S+) max_degree \d+ active_degree \d+ activation (\S+)$/.exec(comment);
    if (match) return { model: match[1], activation: match[2] };
  }
  return undefined;
}

/** Where up is: as the file says, as nerfstudio's do, or else against y, as in those of 3DGS. */
function upOf(comments: string[]): Vector {
  const axis = comments.map((comment) => /^Vertical Axis: *([xyz])$/i.exec(comment)?.[1].toLowerCase()).find(Boolean);
  return axis ? (['x', 'y', 'z'].map((name) => Number(name === axis)) as Vector) : [0, -1, 0];
}

/** The base colour before `activation` is a column's number times `factor`, plus `shift`. */
interface Colors {
  names: string[];
  factor: number;
  shift: number;
  activation: ColorActivation;
  remarks: string[];
}

function findColors({ comments }: PlyHeader, properties: Map<string, PlyProperty>): Colors {
  const has = (names: string[]) => names.every((name) => properties.has(name));
  const own = gsappComment(comments);
  const relu = { activation: ColorActivation.Relu, remarks: [] };
  if (own && PLAIN_MODELS.includes(own.model) && Object.hasOwn(ACTIVATIONS, own.activation) && has(APP_BASE)) {
    const activation = ACTIVATIONS[own.activation];
    return {
      names: APP_BASE,
      factor: 1,
      shift: activation === ColorActivation.Sigmoid ? 0 : 0.5,
      activation,
      remarks: [],
    };
  }
  if (!has(DC)) return { names: RGB, factor: colorFactor(properties.get(RGB[0])!), shift: 0, ...relu };
  const colors = { names: DC, factor: Y0, shift: 0.5, ...relu };
  if (!own || PLAIN_MODELS.includes(own.model)) return colors;
  const remark = `Its appearance model is '${own.model.slice(0, 80)}', of which the base colour is shown. gsapp export --format web writes a file that shows all.`;
  return { ...colors, remarks: [remark] };
}

/** Throws FormatError, which names what is missing, unless the vertices are Gaussians or coloured points. */
function requireColumns({ properties, hasLists }: PlyElement): void {
  const missing = (names: string[]) => names.filter((name) => !properties.has(name));
  if (properties.has('packed_position'))
    throw new FormatError(
      'it is a compressed .ply; this command makes one that the viewer reads: npx @playcanvas/splat-transform in.compressed.ply out.ply',
    );
  if (hasLists) throw new FormatError('its vertices have lists, which the viewer does not read');
  if (missing(POSITION).length > 0)
    throw new FormatError(`its vertices have no property ${missing(POSITION).join(', ')}`);
  const hasColors = missing(RGB).length === 0;
  const shape = missing(GEOMETRY);
  if (hasColors && shape.length === GEOMETRY.length) return;
  const absent = [...shape, ...(hasColors ? [] : missing(DC))];
  const hint = shape.length === GEOMETRY.length ? ' (a mesh or a point cloud without colours, perhaps)' : '';
  if (absent.length > 0)
    throw new FormatError(`its vertices are no Gaussians: there is no property ${absent.join(', ')}${hint}`);
}

const sigmoid = (x: number): number => 1 / (1 + Math.exp(-x));

/** Throws FormatError, which says what is wrong or missing. */
export function readPly(buffer: ArrayBuffer): GaussianSource {
  const header = readPlyHeader(buffer);
  const vertices = header.elements.find(({ name }) => name === 'vertex');
  if (!vertices) throw new FormatError('it has no element vertex, and so no Gaussians');
  requireColumns(vertices);
  const { properties, count } = vertices;
  const rows = new Rows(buffer, header, vertices);
  const copier = (names: string[]) => rows.copier(names.map((name) => properties.get(name)!));
  if (!properties.has('opacity'))
    return readPoints(
      count,
      upOf(header.comments),
      copier(POSITION),
      copier(RGB),
      colorFactor(properties.get(RGB[0])!),
    );

  let coefficients = 0;
  while (properties.has(`f_rest_${coefficients}`)) ++coefficients;
  const fileDegree = Math.sqrt(coefficients / 3 + 1) - 1;
  const degree = Math.min(fileDegree, MOST_DEGREE);
  if (!Number.isInteger(fileDegree))
    throw new FormatError(`it has ${coefficients} properties f_rest_*, expected 0, 9, 24 or 45`);
  // The file has all numbers of red, then of green, then of blue.
  const rest = Array.from(
    { length: restWidth(degree) },
    (_, k) => `f_rest_${(k % 3) * (coefficients / 3) + Math.floor(k / 3)}`,
  );

  const { names, factor, shift, activation, remarks } = findColors(header, properties);
  const copyGeometry = copier([...POSITION, ...GEOMETRY]);
  const copyBase = copier(names);
  const copyRest = copier(rest);
  return {
    count,
    degree,
    up: upOf(header.comments),
    colorActivation: activation,
    antialiased: header.comments.some((comment) => /^SplatRenderMode: *mip(-0\.1)?$/.test(comment)),
    remarks:
      fileDegree > degree
        ? [...remarks, `Of its spherical harmonics of degree ${fileDegree}, those up to degree ${degree} are shown.`]
        : remarks,
    read: (i, row) => {
      copyGeometry(i, row, MEAN); // in the order of a row
      copyBase(i, row, BASE);
      copyRest(i, row, REST);
      for (let k = 0; k < 3; ++k) {
        row[SCALE + k] = Math.exp(row[SCALE + k]);
        row[BASE + k] = row[BASE + k] * factor + shift;
      }
      row[OPACITY] = sigmoid(row[OPACITY]);
    },
  };
}

/** Points that the size of a point is measured at. */
const MOST_MEASURED = 1000;

/**
 * Shows points as small round Gaussians of one size, which follows from the spread of the cloud as if they lay on a
 * surface.
 */
function readPoints(count: number, up: Vector, copyMean: Copy, copyColor: Copy, factor: number): GaussianSource {
  let radius = 0;
  const source: GaussianSource = {
    count,
    degree: 0,
    up,
    antialiased: false,
    colorActivation: ColorActivation.Relu,
    remarks: ['It is a point cloud: its points are shown as dots of one size.'],
    read: (i, row) => {
      copyMean(i, row, MEAN);
      copyColor(i, row, BASE);
      for (let k = 0; k < 3; ++k) {
        row[SCALE + k] = radius;
        row[BASE + k] *= factor;
      }
      row[ROTATION] = row[OPACITY] = 1;
      row[ROTATION + 1] = row[ROTATION + 2] = row[ROTATION + 3] = 0;
    },
  };
  const row = new Float64Array(rowWidth(0));
  const measured = Math.min(count, MOST_MEASURED);
  const means: Float64Array[] = [];
  for (let k = 0; k < measured; ++k) {
    source.read(Math.floor((k * count) / measured), row);
    if (row.every(Number.isFinite)) means.push(row.slice(MEAN, MEAN + 3));
  }
  const middleOf = (values: number[]) => values.sort((a, b) => a - b)[values.length >> 1] ?? 0;
  const middle = [0, 1, 2].map((axis) => middleOf(means.map((mean) => mean[axis])));
  radius = middleOf(means.map((mean) => Math.hypot(...mean.map((x, axis) => x - middle[axis])))) / Math.sqrt(count);
  return source;
}
