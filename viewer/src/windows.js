/** Windows against ringing, as `gash_jax.light.windows`: by a first band that is gone, or the least that does. */

import { bandIndex, bandsOf, basis } from "./sh.js";
import { clampedCosine } from "./lobes.js";

const [DIP, DIRECTIONS, STEPS, SPAN, HALVINGS] = [1e-6, 4096, 236, 1e-4, 16];
const [CELLS, CANDIDATES, ZOOMS] = [64, 8, 9]; // parts of the sphere; lowest of them that are looked at closely; to a third
const found = new WeakMap(); // factors of a light by kind and bands: the search takes a moment

/** Factors of a light's coefficients for a result of so many bands, by the state of the page. */
export function factorsFor({ window: kind, width }, coefficients, bands) {
  if (kind !== "radiance" && kind !== "irradiance") return windowFactors(kind, width, bands);
  const known = found.get(coefficients) ?? {};
  found.set(coefficients, known);
  known[`${kind} ${bands}`] ??= leastWindow(coefficients.slice(0, 3 * bands * bands), kind);
  return known[`${kind} ${bands}`];
}

/** Factor of each coefficient against ringing; the first band that vanishes is l = width. */
export function windowFactors(kind, width, bands) {
  const shapes = {
    none: () => 1,
    hann: (r) => (r < 1 ? (1 + Math.cos(Math.PI * r)) / 2 : 0),
    lanczos: (r) => (r === 0 ? 1 : r < 1 ? Math.sin(Math.PI * r) / (Math.PI * r) : 0),
  };
  return bandIndex(bands).map((l) => shapes[kind](l / width));
}

/** 1 / (1 + lambda l^2 (l+1)^2) with the least lambda at which "radiance" or "irradiance" is nowhere negative. */
export function leastWindow(light, kind) {
  const bands = bandsOf(light.length / 3);
  const band = bandIndex(bands);
  const size = band.map((l) => (kind === "irradiance" ? clampedCosine(l) / Math.PI : 1));
  const colours = [0, 1, 2]
    .map((c) => Float64Array.from(band, (_, k) => light[3 * k + c] * size[k]))
    .filter((values) => values.some((value) => value !== 0));
  if (colours.some((values) => values[0] <= 0)) return band.map(() => 1); // no window helps: shown as it is
  for (const values of colours)
    values.forEach((value, k, all) => k && (all[k] = (value / all[0]) * 2 * Math.sqrt(Math.PI)));
  for (const values of colours) values[0] = 2 * Math.sqrt(Math.PI);
  const factors = (strength) => band.map((l) => 1 / (1 + strength * (l * (l + 1)) ** 2));
  const dips = (strength) => colours.some((values) => leastValue(values, factors(strength)) < -DIP);
  if (!dips(0)) return factors(0);
  const most = Math.max(...colours.map((values) => enough(values, bands)));
  const steps = Array.from({ length: STEPS }, (_, i) => most * SPAN ** (1 - i / (STEPS - 1)));
  const first = steps.findIndex((strength) => !dips(strength));
  const above = first < 0 ? STEPS - 1 : first;
  let [low, high] = [above ? steps[above - 1] : 0, steps[above]];
  for (let i = 0; i < HALVINGS; i++) {
    const middle = (low + high) / 2;
    if (dips(middle)) low = middle;
    else high = middle;
  }
  return factors(high);
}

/** A lambda that is enough: bounds of all bands over lambda l^2 (l+1)^2 add up to the mean. */
function enough(values, bands) {
  let sum = 0;
  for (let l = 1; l < bands; l++) {
    const length = Math.hypot(...values.subarray(l * l, (l + 1) ** 2));
    sum += (Math.sqrt((2 * l + 1) / (4 * Math.PI)) * length) / (l * (l + 1)) ** 2;
  }
  return sum;
}

/** The least value in any direction: from the lowest of fixed directions, closer and closer. */
function leastValue(coefficients, factors) {
  const bands = Math.sqrt(coefficients.length);
  const values = coefficients.map((value, k) => value * factors[k]);
  const out = new Float64Array(values.length);
  const at = (x, y, z) => basis(x, y, z, bands, out).reduce((sum, y_k, k) => sum + y_k * values[k], 0);
  const fixed = tableOf(bands);
  const lowest = Array.from({ length: CELLS }, () => ({ value: Infinity, place: null }));
  for (let n = 0; n < DIRECTIONS; n++) {
    let value = 0;
    for (let k = 0; k < values.length; k++) value += values[k] * fixed.harmonics[n * values.length + k];
    if (value < lowest[fixed.cells[n]].value) lowest[fixed.cells[n]] = { value, place: fixed.directions[n] };
  }
  lowest.sort((one, other) => one.value - other.value);
  if (lowest[0].value < -DIP) return lowest[0].value;
  return Math.min(...lowest.slice(0, CANDIDATES).map(({ place }) => closer(at, place)));
}

function closer(at, place) {
  let [centre, best] = [place, Infinity];
  for (let zoom = 0, reach = Math.sqrt((4 * Math.PI) / DIRECTIONS); zoom < ZOOMS; zoom++, reach /= 3) {
    const [x, y, z] = centre;
    const side = Math.abs(x) < 0.6 ? unit(0, z, -y) : unit(-z, 0, x);
    const up = [y * side[2] - z * side[1], z * side[0] - x * side[2], x * side[1] - y * side[0]];
    best = Infinity;
    for (let i = -3; i <= 3; i++) {
      for (let j = -3; j <= 3; j++) {
        const near = unit(...[0, 1, 2].map((d) => [x, y, z][d] + (reach / 3) * (i * side[d] + j * up[d])));
        const value = at(...near);
        if (value < best) [best, centre] = [value, near];
      }
    }
  }
  return best;
}

function unit(x, y, z) {
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}

const tables = {};

/** Fixed directions in even spirals, their harmonics, and the part of the sphere that each lies in. */
function tableOf(bands) {
  tables[bands] ??= makeTable(bands);
  return tables[bands];
}

function makeTable(bands) {
  const harmonics = new Float32Array(DIRECTIONS * bands * bands);
  const cells = new Uint8Array(DIRECTIONS);
  const directions = Array.from({ length: DIRECTIONS }, (_, n) => {
    const z = 1 - (2 * n + 1) / DIRECTIONS;
    const turns = (n * (Math.sqrt(5) - 1)) / 2;
    const [r, angle] = [Math.sqrt(1 - z * z), 2 * Math.PI * (turns - Math.floor(turns))];
    const place = [r * Math.cos(angle), r * Math.sin(angle), z];
    harmonics.set(basis(...place, bands, new Float64Array(bands * bands)), n * bands * bands);
    const side = Math.sqrt(CELLS);
    cells[n] = Math.floor(((1 - z) / 2) * side) * side + Math.floor((angle / (2 * Math.PI)) * side);
    return place;
  });
  return { harmonics, cells, directions };
}
