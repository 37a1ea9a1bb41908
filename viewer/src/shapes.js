/** What a transfer file holds, checked and made ready to draw: a mesh that may move, and methods that shade it. */

import { bounds } from "./camera.js";
import { clampedCosine, hemisphere } from "./lobes.js";
import { numbersAt, seriesOf, someOf } from "./frames.js";
import { floats } from "./half.js";
import { basis, bandsOf } from "./sh.js";

/** What a data texture holds, as the shader counts. */
export const [GREY, COLOURED, VISIBILITY, MATRICES] = [0, 1, 2, 3];

/**
 * The mesh of a transfer file: { frames, count, places, facing, faces, used, names }, `places` and `facing` the series
 * of its positions and normals. Transfer in a texture belongs to
 * corners of faces: then every corner is a vertex of its own, with `uv`, and `side` counts the texels along a side.
 * `names` are the vertices' numbers in the file. Throws Error with one line.
 */
export function readMesh(file) {
  const mesh = readVertices(file);
  const { texture, uv } = file.arrays;
  if (!texture) return mesh;
  if (!uv || uv.data.length !== 2 * mesh.faces.length || texture.shape[0] !== texture.shape[1])
    throw new Error("its texture or texture coordinates do not fit its faces");
  return { ...atCorners(mesh), uv: floats(uv), side: texture.shape[0] };
}

function atCorners(mesh) {
  const corners = mesh.faces;
  const spread = (series) => {
    const data = series.at(0);
    const at = () =>
      data.constructor.from({ length: 3 * corners.length }, (_, i) => data[3 * corners[Math.floor(i / 3)] + (i % 3)]);
    return { ...series, at };
  };
  const all = Uint32Array.from(corners.keys());
  return {
    ...mesh,
    count: corners.length,
    places: spread(mesh.places),
    facing: spread(mesh.facing),
    faces: all,
    used: all,
    names: corners,
  };
}

function readVertices({ arrays, metadata }) {
  const faces = need(arrays, "faces", 2);
  const places = seriesOf(arrays, "vertices", () => 2) ?? seriesOf(arrays, "verts", () => 2);
  if (!places) throw new Error("it has no vertices");
  const [count, three] = places.inner;
  if (three !== 3 || faces.shape[1] !== 3) throw new Error("its vertices or faces are no triples");
  const used = new Uint8Array(count);
  for (const vertex of faces.data) {
    if (vertex < 0 || vertex >= count) throw new Error("its faces name vertices that do not exist");
    used[vertex] = 1;
  }
  const mesh = {
    frames: places.frames,
    count,
    places,
    facing: facingOf(arrays, places),
    faces: Uint32Array.from(faces.data),
    used: Uint32Array.from(used.keys()).filter((vertex) => used[vertex]),
    names: Uint32Array.from({ length: count }, (_, vertex) => vertex),
    uv: null,
    side: 0,
    grid: metadata.grid ?? null,
    box: { center: [0, 0, 0], size: 1 },
  };
  if (!mesh.used.length) throw new Error("it has no faces to draw");
  mesh.box = bounds(positions(mesh, 0), mesh.used);
  return mesh;
}

/** The normals of a file, of as many frames as it has positions; 0 where it has none. */
function facingOf(arrays, { frames, inner }) {
  const [count] = inner;
  const found = seriesOf(arrays, "normals", () => 2);
  if (found?.inner.join() === inner.join() && found.frames === frames) return found;
  return { frames: 1, inner, kind: "f4", at: () => new Float32Array(3 * count) };
}

/** Positions of a frame in terms of the first one's box: what is far from the origin keeps its digits. */
export function positions({ places, grid, box }, frame) {
  const numbers = numbersAt(places, frame);
  // 16-bit whole numbers count steps of a grid
  const [low, step] =
    grid && places.kind === "u2"
      ? [grid.low, grid.step]
      : [
          [0, 0, 0],
          [1, 1, 1],
        ];
  return Float32Array.from(numbers, (value, i) => (low[i % 3] + value * step[i % 3] - box.center[i % 3]) / box.size);
}

/** Unit normals of a frame, 0 where there is none; what was rounded for frames has its length again. */
export function normalsAt({ facing }, frame) {
  const normals = Float32Array.from(numbersAt(facing, frame));
  if (facing.frames === 1) return normals;
  for (let i = 0; i < normals.length; i += 3) {
    const length = Math.hypot(normals[i], normals[i + 1], normals[i + 2]);
    for (let c = 0; c < 3; c++) normals[i + c] = length > 0.5 ? normals[i + c] / length : 0;
  }
  return normals;
}

/** A method from a transfer file or one of the page's own. Throws Error with one line. */
export function readMethod({ arrays }, name, mesh) {
  const rows = mesh.side ** 2 || mesh.count;
  const coloured = (shape) => shape.length > 2 && shape.at(-1) === 3;
  const given = mesh.side ? { coefficients: inRows(arrays.texture) } : arrays;
  const found = seriesOf(given, "coefficients", (shape) => (coloured(shape) ? 3 : 2));
  if (!found) throw new Error("it has no coefficients: bake or predict a transfer");
  const { frames, inner } = found;
  const bands = bandsOf(inner[1]);
  if (!bands || inner[0] !== rows) {
    const fitting = `${rows} ${mesh.side ? "texels" : "vertices"}`;
    throw new Error(`its coefficients have shape (${inner.join(", ")}), which does not fit ${fitting}`);
  }
  if (mesh.frames > 1 && frames > 1 && mesh.frames !== frames)
    throw new Error("its frames do not fit those of the mesh");
  const errors = {};
  for (const error of ["standard_error", "predicted_error"]) {
    if (arrays[error]) errors[error] = rootMeanSquare(floats(arrays[error]), rows);
  }
  const gloss = mesh.side ? null : readGloss(arrays, rows, bands, frames);
  return { name, bands, frames, coefficients: found, coloured: inner.length === 3, errors, limits: {}, gloss };
}

/** What gloss is made of, { kind, series }, or null. */
function readGloss(arrays, rows, bands, frames) {
  const seen = seriesOf(arrays, "visibility", () => 2);
  const series = seen ?? seriesOf(arrays, "matrices", () => 3);
  if (!series) return null;
  const wanted = seen ? [rows, (2 * bands - 1) ** 2] : [rows, bands ** 2, bands ** 2];
  if (series.frames !== frames || series.inner.join() !== wanted.join())
    throw new Error("what it holds for gloss does not fit its coefficients");
  return { kind: seen ? VISIBILITY : MATRICES, series };
}

/** Texels one after the other, as vertices are. */
function inRows(texture) {
  return texture && { ...texture, shape: [texture.shape[0] * texture.shape[1], ...texture.shape.slice(2)] };
}

/** The closed form without shadows, (A_l / pi) Y_k(n), and the hemisphere of each normal for gloss, of every frame. */
export function closedForm(mesh, bands, glossy) {
  const series = (count, kernel) => ({
    frames: mesh.facing.frames,
    inner: [mesh.count, count * count],
    kind: "f4",
    at: (frame) => overNormals(normalsAt(mesh, frame), count, kernel),
  });
  return {
    name: "closed form, no shadows",
    bands,
    frames: mesh.facing.frames,
    coefficients: series(bands, (l) => clampedCosine(l) / Math.PI),
    coloured: false,
    errors: {},
    limits: {},
    gloss: glossy ? { kind: VISIBILITY, series: series(2 * bands - 1, hemisphere) } : null,
    closed: true,
  };
}

function overNormals(normals, bands, kernel) {
  const count = normals.length / 3;
  const data = new Float32Array(count * bands * bands);
  const values = new Float64Array(bands * bands);
  const factors = Array.from(values, (_, k) => kernel(Math.floor(Math.sqrt(k))));
  for (let v = 0; v < count; v++) {
    const [x, y, z] = normals.subarray(3 * v, 3 * v + 3);
    if (x === 0 && y === 0 && z === 0) continue;
    basis(x, y, z, bands, values);
    for (let k = 0; k < values.length; k++) data[v * values.length + k] = values[k] * factors[k];
  }
  return data;
}

/** Largest size over the vertices, of many frames: of the coefficient of that number, or the error of that name. */
export function limitOf(method, which) {
  const { limits, errors } = method;
  const find = () =>
    errors[which] ? errors[which].reduce((a, b) => Math.max(a, b), 0) : coefficientRange(method, which);
  limits[which] ??= find() || 1;
  return limits[which];
}

function coefficientRange({ coefficients, coloured, bands }, k) {
  const each = coloured ? 3 : 1;
  const step = bands * bands * each;
  let limit = 0;
  for (const frame of someOf(coefficients.frames)) {
    const data = numbersAt(coefficients, frame);
    for (let at = k * each; at < data.length; at += step) {
      let sum = 0;
      for (let c = 0; c < each; c++) sum += data[at + c];
      limit = Math.max(limit, Math.abs(sum / each));
    }
  }
  return limit;
}

function rootMeanSquare(values, count) {
  const each = values.length / count;
  return Float32Array.from({ length: count }, (_, v) => {
    let sum = 0;
    for (let i = v * each; i < (v + 1) * each; i++) sum += values[i] * values[i];
    return Math.sqrt(sum / each);
  });
}

function need(arrays, name, sides) {
  if (arrays[name]?.shape.length !== sides) throw new Error(`it has no array ${name} of ${sides} dimensions`);
  return arrays[name];
}
