/** What a transfer file holds, checked and made ready to draw: a mesh that may move, and methods that shade it. */

import { bounds } from "./camera.js";
import { clampedCosine, hemisphere } from "./lobes.js";
import { floats, fromHalf } from "./half.js";
import { basis, bandsOf } from "./sh.js";

/** What a data texture holds, as the shader counts. */
export const [GREY, COLOURED, VISIBILITY, MATRICES] = [0, 1, 2, 3];

/**
 * The mesh of a transfer file: { frames, count, places, normals, faces, used, names }. Transfer in a texture belongs to
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
  const spread = (data) =>
    data.constructor.from({ length: 3 * corners.length }, (_, i) => data[3 * corners[Math.floor(i / 3)] + (i % 3)]);
  const all = Uint32Array.from(corners.keys());
  return {
    ...mesh,
    count: corners.length,
    places: { ...mesh.places, data: spread(mesh.places.data) },
    normals: spread(mesh.normals),
    faces: all,
    used: all,
    names: corners,
  };
}

function readVertices({ arrays, metadata }) {
  const faces = need(arrays, "faces", 2);
  const places = arrays.vertices ?? arrays.verts;
  if (!places) throw new Error("it has no vertices");
  const moving = places.shape.length === 3;
  const [count, three] = places.shape.slice(-2);
  if (three !== 3 || faces.shape[1] !== 3) throw new Error("its vertices or faces are no triples");
  const used = new Uint8Array(count);
  for (const vertex of faces.data) {
    if (vertex < 0 || vertex >= count) throw new Error("its faces name vertices that do not exist");
    used[vertex] = 1;
  }
  const mesh = {
    frames: moving ? places.shape[0] : 1,
    count,
    places,
    faces: Uint32Array.from(faces.data),
    used: Uint32Array.from(used.keys()).filter((vertex) => used[vertex]),
    normals: arrays.normals?.shape.length === 2 ? floats(arrays.normals) : new Float32Array(3 * count),
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

/** Positions of a frame in terms of the first one's box: what is far from the origin keeps its digits. */
export function positions({ places, count, frames, grid, box }, frame) {
  const start = Math.min(frame, frames - 1) * 3 * count;
  const inFile = { kind: places.kind, data: places.data.subarray(start, start + 3 * count) };
  const numbers = places.kind === "f2" ? floats(inFile) : inFile.data;
  // 16-bit whole numbers count steps of a grid
  const [low, step] = grid
    ? [grid.low, grid.step]
    : [
        [0, 0, 0],
        [1, 1, 1],
      ];
  return Float32Array.from(numbers, (value, i) => (low[i % 3] + value * step[i % 3] - box.center[i % 3]) / box.size);
}

/** A method from a transfer file or one of the page's own. Throws Error with one line. */
export function readMethod({ arrays }, name, mesh) {
  const found = mesh.side ? inRows(arrays.texture) : arrays.coefficients;
  if (!found) throw new Error("it has no coefficients: bake or predict a transfer");
  const rows = mesh.side ** 2 || mesh.count;
  const coloured = found.shape.at(-1) === 3 && found.shape.length > 2;
  const inner = found.shape.slice(coloured ? -3 : -2);
  const frames = found.shape.length > inner.length ? found.shape[0] : 1;
  const bands = bandsOf(inner[1]);
  if (found.shape.length > inner.length + 1 || !bands || inner[0] !== rows) {
    const fitting = `${rows} ${mesh.side ? "texels" : "vertices"}`;
    throw new Error(`its coefficients have shape (${found.shape.join(", ")}), which does not fit ${fitting}`);
  }
  if (mesh.frames > 1 && frames > 1 && mesh.frames !== frames)
    throw new Error("its frames do not fit those of the mesh");
  const method = { name, bands, frames, coefficients: found, coloured, errors: {}, limits: {}, gloss: null };
  for (const error of ["standard_error", "predicted_error"]) {
    if (arrays[error]) method.errors[error] = rootMeanSquare(floats(arrays[error]), rows);
  }
  const gloss = arrays.visibility ?? arrays.matrices;
  if (gloss && frames === 1) method.gloss = { kind: arrays.visibility ? VISIBILITY : MATRICES, array: gloss };
  return method;
}

/** Texels one after the other, as vertices are. */
function inRows(texture) {
  return { ...texture, shape: [texture.shape[0] * texture.shape[1], ...texture.shape.slice(2)] };
}

/** The closed form without shadows, (A_l / pi) Y_k(n), and the hemisphere of each normal for gloss. */
export function closedForm(mesh, bands, glossy) {
  const coefficients = overNormals(mesh, bands, (l) => clampedCosine(l) / Math.PI);
  const gloss = glossy ? { kind: VISIBILITY, array: overNormals(mesh, 2 * bands - 1, hemisphere) } : null;
  return {
    name: "closed form, no shadows",
    bands,
    frames: 1,
    coefficients,
    coloured: false,
    errors: {},
    gloss,
    closed: true,
  };
}

function overNormals({ normals, count }, bands, kernel) {
  const data = new Float32Array(count * bands * bands);
  const values = new Float64Array(bands * bands);
  const factors = Array.from(values, (_, k) => kernel(Math.floor(Math.sqrt(k))));
  for (let v = 0; v < count; v++) {
    const [x, y, z] = normals.subarray(3 * v, 3 * v + 3);
    if (x === 0 && y === 0 && z === 0) continue;
    basis(x, y, z, bands, values).forEach((value, k) => (data[v * values.length + k] = value * factors[k]));
  }
  return { kind: "f4", shape: [count, values.length], data };
}

/** Largest size over the vertices, of all frames: of the coefficient of that number, or the error of that name. */
export function limitOf(method, which) {
  const { limits, errors } = method;
  const find = () =>
    errors[which] ? errors[which].reduce((a, b) => Math.max(a, b), 0) : coefficientRange(method, which);
  limits[which] ??= find() || 1;
  return limits[which];
}

function coefficientRange(method, k) {
  const { coefficients, coloured, bands } = method;
  const each = coloured ? 3 : 1;
  const step = bands * bands * each;
  const half = coefficients.kind === "f2";
  let limit = 0;
  for (let at = k * each; at < coefficients.data.length; at += step) {
    let sum = 0;
    for (let c = 0; c < each; c++) sum += half ? fromHalf(coefficients.data[at + c]) : coefficients.data[at + c];
    limit = Math.max(limit, Math.abs(sum / each));
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
