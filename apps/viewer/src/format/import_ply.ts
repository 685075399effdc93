// SPDX-License-Identifier: Apache-2.0
// Reads .ply files of Gaussians as 3DGS and most programs after it write them, and of coloured points. Columns go by their names.

import { FormatError } from './cursor';
import { BASE, MEAN, MOST_DEGREE, OPACITY, REST, ROTATION, SCALE, Y0, restWidth, rowWidth, type GaussianSource } from './gaussian_source';
import { ColorActivation } from './ngsplat';
import { readPlyHeader, type PlyElement, type PlyHeader, type PlyProperty } from './ply_header';

const indexed = (prefix: string, count: number): string[] => Array.from({ length: count }, (_, k) => `${prefix}_${k}`);

const POSITION = ['x', 'y', 'z'], GEOMETRY = ['opacity', ...indexed('scale', 3), ...indexed('rot', 4)], DC = indexed('f_dc', 3), RGB = ['red', 'green', 'blue'];
const LARGEST_CODE: Record<string, number> = { uchar: 255, uint8: 255, ushort: 65535, uint16: 65535 };
const ACTIVATIONS: Record<string, ColorActivation> = {
  relu: ColorActivation.Relu, softplus: ColorActivation.Softplus, sigmoid: ColorActivation.Sigmoid, hardsigmoid: ColorActivation.HardSigmoid,
};
/** Models of gsapp that f_dc and f_rest hold completely. */
const PLAIN_MODELS = ['sh', 'none'];

/** The rows of one element: numbers by column. */
class Rows {
  private readonly view: DataView;

  constructor(buffer: ArrayBuffer, private readonly header: PlyHeader, readonly element: PlyElement) {
    let begin = header.bytes;
    for (const before of header.elements) {
      if (before === element) break;
      if (before.hasLists) throw new FormatError(`its element ${before.name.slice(0, 80)}, in front of the vertices, has lists, which the viewer does not read`);
      begin += before.count * before.stride;
    }
    const bytes = element.count * element.stride, rest = buffer.byteLength - begin;
    if (!(bytes <= rest)) throw new FormatError(`the file is truncated: ${element.count} vertices take ${bytes} bytes, but only ${Math.max(rest, 0)} follow`);
    this.view = new DataView(buffer, begin, bytes);
  }

  /** Copies a row's numbers of these columns to `out`, from `at` on. */
  copier(columns: PlyProperty[]): (row: number, out: Float64Array, at: number) => void {
    const { view, header: { littleEndian }, element: { stride } } = this;
    if (columns.some(({ type }) => type !== 'float' && type !== 'float32')) {
      return (row, out, at) => columns.forEach(({ offset, read }, k) => (out[at + k] = read(view, row * stride + offset, littleEndian)));
    }
    const offsets = Float64Array.from(columns, ({ offset }) => offset); // what almost all files have, and several times as fast
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

const sigmoid = (x: number): number => 1 / (1 + Math.exp(-x));

/** Throws FormatError, which says what is wrong or missing. */
export function readPly(buffer: ArrayBuffer): GaussianSource {
  const header = readPlyHeader(buffer), vertices = header.elements.find(({ name }) => name === 'vertex');
  if (!vertices) throw new FormatError('it has no element vertex, and so no Gaussians');
  const { properties, count } = vertices;
  if (properties.has('packed_position')) throw new FormatError('it is a compressed .ply; this command makes one that the viewer reads: splat-transform in.compressed.ply out.ply');
  if (vertices.hasLists) throw new FormatError('its vertices have lists, which the viewer does not read');
  const missing = (names: string[]) => names.filter((name) => !properties.has(name));
  const columns = (names: string[]) => names.map((name) => properties.get(name)!);
  if (missing(POSITION).length > 0) throw new FormatError(`its vertices have no property ${missing(POSITION).join(', ')}`);
  const hasColors = missing(RGB).length === 0;
  if (missing(GEOMETRY).length === GEOMETRY.length && hasColors) return readPoints(new Rows(buffer, header, vertices), count, columns([...POSITION, ...RGB]));
  const absent = [...missing(GEOMETRY), ...(hasColors ? [] : missing(DC))];
  if (absent.length > 0)
    throw new FormatError(`its vertices are no Gaussians: there is no property ${absent.join(', ')}${absent.length > 7 ? ' (a mesh or a point cloud without colours, perhaps)' : ''}`);

  const remarks: string[] = [];
  const rows = new Rows(buffer, header, vertices);
  let base = columns(missing(DC).length === 0 ? DC : RGB), factor = base.map(({ type }) => 1 / (LARGEST_CODE[type] ?? 1)), shift = 0;
  if (missing(DC).length === 0) [factor, shift] = [[Y0, Y0, Y0], 0.5];
  let colorActivation = ColorActivation.Relu;
  const own = gsappComment(header.comments);
  if (own && !PLAIN_MODELS.includes(own.model)) {
    remarks.push(`Its appearance model is '${own.model.slice(0, 80)}', of which the base colour is shown: a .ply has no place for the rest that other programs know. Export the run with --format web to see all.`);
  } else if (own && Object.hasOwn(ACTIVATIONS, own.activation) && missing(indexed('app_base', 3)).length === 0) {
    colorActivation = ACTIVATIONS[own.activation];
    base = columns(indexed('app_base', 3));
    factor = [1, 1, 1];
    shift = colorActivation === ColorActivation.Sigmoid ? 0 : 0.5;
  }

  let coefficients = 0;
  while (properties.has(`f_rest_${coefficients}`)) ++coefficients;
  const fileDegree = Math.sqrt(coefficients / 3 + 1) - 1, degree = Math.min(fileDegree, MOST_DEGREE);
  if (!Number.isInteger(fileDegree)) throw new FormatError(`it has ${coefficients} properties f_rest_*, expected 0, 9, 24 or 45`);
  if (fileDegree > degree) remarks.push(`Of its spherical harmonics of degree ${fileDegree}, those up to degree ${degree} are shown.`);
  // The file has all numbers of red, then of green, then of blue.
  const rest = Array.from({ length: restWidth(degree) }, (_, k) => `f_rest_${(k % 3) * (coefficients / 3) + Math.floor(k / 3)}`);
  const copyGeometry = rows.copier(columns([...POSITION, ...indexed('scale', 3), ...indexed('rot', 4), 'opacity'])), copyBase = rows.copier(base), copyRest = rows.copier(columns(rest));

  return {
    count, degree, up: [0, -1, 0], colorActivation, remarks, antialiased: header.comments.some((comment) => /^SplatRenderMode: *mip$/.test(comment)),
    read: (i, row) => {
      copyGeometry(i, row, MEAN); // in the order of a row
      copyBase(i, row, BASE);
      copyRest(i, row, REST);
      for (let k = 0; k < 3; ++k) {
        row[SCALE + k] = Math.exp(row[SCALE + k]);
        row[BASE + k] = row[BASE + k] * factor[k] + shift;
      }
      row[OPACITY] = sigmoid(row[OPACITY]);
    },
  };
}

/** Points that the size of a point is measured at. */
const MOST_MEASURED = 1000;

/** Shows points as small round Gaussians of one size, which follows from the spread of the cloud as if they lay on a surface. */
function readPoints(rows: Rows, count: number, columns: PlyProperty[]): GaussianSource {
  const factor = columns.slice(3).map(({ type }) => 1 / (LARGEST_CODE[type] ?? 1)), copyMean = rows.copier(columns.slice(0, 3)), copyColor = rows.copier(columns.slice(3));
  let radius = 0;
  const source: GaussianSource = {
    count, degree: 0, up: [0, -1, 0], antialiased: false, colorActivation: ColorActivation.Relu, remarks: ['It is a point cloud: its points are shown as dots of one size.'],
    read: (i, row) => {
      copyMean(i, row, MEAN);
      copyColor(i, row, BASE);
      for (let k = 0; k < 3; ++k) {
        row[SCALE + k] = radius;
        row[BASE + k] *= factor[k];
      }
      row[ROTATION] = row[OPACITY] = 1;
      row[ROTATION + 1] = row[ROTATION + 2] = row[ROTATION + 3] = 0;
    },
  };
  const row = new Float64Array(rowWidth(0)), measured = Math.min(count, MOST_MEASURED), means: Float64Array[] = [];
  for (let k = 0; k < measured; ++k) {
    source.read(Math.floor((k * count) / measured), row);
    if (row.every(Number.isFinite)) means.push(row.slice(MEAN, MEAN + 3));
  }
  const middleOf = (values: number[]) => values.sort((a, b) => a - b)[values.length >> 1] ?? 0;
  const middle = [0, 1, 2].map((axis) => middleOf(means.map((mean) => mean[axis])));
  radius = middleOf(means.map((mean) => Math.hypot(...mean.map((x, axis) => x - middle[axis])))) / Math.sqrt(count);
  return source;
}
