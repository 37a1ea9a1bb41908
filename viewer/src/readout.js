/** Numbers under the pointer: the nearest vertex, and the value that the picture shows there. */

import { place } from "./gestures.js";
import { byId } from "./panel.js";

export function bindReadout(scene) {
  const canvas = byId("picture");
  let last = null;
  const show = () => {
    if (!last || !scene.mesh) return;
    const hit = nearestVertex(scene, place(canvas, last));
    const box = canvas.getBoundingClientRect();
    const [x, y] = [last.clientX - box.left, last.clientY - box.top].map((value, i) =>
      Math.min(scene.size[i] - 1, Math.max(0, Math.floor((value / [box.width, box.height][i]) * scene.size[i]))),
    );
    const value = hit && scene.valueAt(x, y);
    byId("readout").hidden = !value;
    if (value) byId("readout").textContent = words(scene, hit, value);
  };
  canvas.addEventListener("pointermove", (event) => {
    last = event;
    if (!event.buttons) requestAnimationFrame(show);
  });
  canvas.addEventListener("pointerleave", () => (byId("readout").hidden = true));
}

function words(scene, { vertex, position }, value) {
  const text = (numbers) => numbers.map((number) => Number(number.toPrecision(3))).join(", ");
  const { state } = scene;
  const says = {
    light: () => `radiance ${text(value)} (red, green, blue)`,
    difference: () => `difference of radiance ${text([value[0]])}, ${text([value[0] * scene.exposure])} of white`,
    coefficient: () => `coefficient ${state.coefficient}: ${text([value[0]])}`,
    standard_error: () => `standard error ${text([value[0]])}`,
    predicted_error: () => `predicted error ${text([value[0]])}`,
  };
  return `${says[state.show]()}\nvertex ${vertex} at ${text(position)}`;
}

/** The corner nearest to where a ray through a point of the picture first meets a face, or null (Möller & Trumbore). */
function nearestVertex(scene, [x, y]) {
  const { camera, aspect, mesh, points } = scene;
  const [origin, d] = [camera.clip(aspect).eye, camera.ray(x, y, aspect)];
  let best = { t: Infinity };
  for (let f = 0; f < mesh.faces.length; f += 3) {
    const [a, b, c] = [3 * mesh.faces[f], 3 * mesh.faces[f + 1], 3 * mesh.faces[f + 2]];
    const [e1x, e1y, e1z] = [points[b] - points[a], points[b + 1] - points[a + 1], points[b + 2] - points[a + 2]];
    const [e2x, e2y, e2z] = [points[c] - points[a], points[c + 1] - points[a + 1], points[c + 2] - points[a + 2]];
    const [px, py, pz] = [d[1] * e2z - d[2] * e2y, d[2] * e2x - d[0] * e2z, d[0] * e2y - d[1] * e2x];
    const determinant = e1x * px + e1y * py + e1z * pz;
    const [sx, sy, sz] = [origin[0] - points[a], origin[1] - points[a + 1], origin[2] - points[a + 2]];
    const u = (sx * px + sy * py + sz * pz) / determinant;
    if (!(u >= 0 && u <= 1)) continue;
    const [qx, qy, qz] = [sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x];
    const v = (d[0] * qx + d[1] * qy + d[2] * qz) / determinant;
    const t = (e2x * qx + e2y * qy + e2z * qz) / determinant;
    if (v >= 0 && u + v <= 1 && t > 0 && t < best.t) best = { t, f, weights: [1 - u - v, u, v] };
  }
  if (best.t === Infinity) return null;
  const corner = mesh.faces[best.f + best.weights.indexOf(Math.max(...best.weights))];
  const position = [0, 1, 2].map((i) => points[3 * corner + i] * mesh.box.size + mesh.box.center[i]);
  return { vertex: mesh.names[corner], position };
}
