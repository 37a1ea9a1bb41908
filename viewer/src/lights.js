/** Lights by their coefficients, and the map or the bands of a light as what stands behind the mesh. */

import { floats, toHalf } from "./half.js";
import { bandsOf, projectMap, radianceToward } from "./sh.js";
import { factorsFor } from "./windows.js";

const BANDS = 10; // that a map is kept in
const BLURRED = [64, 32]; // pixels of a background that is made of bands
const WIDEST = 512; // pixels of a background map

/** A light from a file's arrays: coefficients (k, 3), and perhaps a map (h, w, 3). Throws Error with one line. */
export function readLight({ arrays }, name) {
  const { coefficients, map } = arrays;
  if (coefficients?.shape.length !== 2 || coefficients.shape[1] !== 3 || !bandsOf(coefficients.shape[0])) {
    throw new Error("it is no light: coefficients must be (bands², 3)");
  }
  const kept = map && { width: map.shape[1], height: map.shape[0], halfs: map.data };
  return makeLight(name, Float64Array.from(floats(coefficients)), kept);
}

/** A light from a latlong map { width, height, pixels }. */
export function lightOfMap(map, name) {
  if (!map.pixels.every(Number.isFinite)) throw new Error("it holds radiance that is not finite");
  const small = shrunk(map);
  return makeLight(name, projectMap(map, BANDS), { ...small, halfs: Uint16Array.from(small.pixels, toHalf) });
}

function makeLight(name, coefficients, map) {
  const surroundings = (background, scene) => {
    if (background === "ground") return null;
    return background === "map" && map ? map : blurred(coefficients, scene);
  };
  return { name, coefficients, bands: bandsOf(coefficients.length / 3), map, surroundings };
}

/** What the bands of the method keep of a light, before it is turned. */
function blurred(coefficients, { method, state }) {
  const factors = factorsFor(state, coefficients, method.bands);
  const light = coefficients.slice(0, 3 * factors.length).map((value, i) => value * factors[Math.floor(i / 3)]);
  const [width, height] = BLURRED;
  const halfs = new Uint16Array(width * height * 3);
  for (let i = 0; i < height; i++) {
    const t = ((i + 0.5) / height) * Math.PI;
    for (let j = 0; j < width; j++) {
      const p = ((j + 0.5) / width - 0.5) * 2 * Math.PI;
      const radiance = radianceToward(light, Math.sin(t) * Math.sin(p), Math.cos(t), -Math.sin(t) * Math.cos(p));
      halfs.set(radiance.map(toHalf), (i * width + j) * 3);
    }
  }
  return { width, height, halfs };
}

/** The map as means over squares of pixels, so many that it is narrow enough. */
function shrunk({ width, height, pixels }) {
  const step = Math.ceil(width / WIDEST);
  const [wide, high] = [Math.floor(width / step), Math.floor(height / step)];
  const small = new Float32Array(wide * high * 3);
  for (let i = 0; i < high * step; i++) {
    for (let j = 0; j < wide * step; j++) {
      const to = (Math.floor(i / step) * wide + Math.floor(j / step)) * 3;
      for (let c = 0; c < 3; c++) small[to + c] += pixels[(i * width + j) * 3 + c] / (step * step);
    }
  }
  return { width: wide, height: high, pixels: small };
}
