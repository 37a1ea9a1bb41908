/**
 * Arrays with a part for every frame: as they are, or as a mean and principal components, of which frame i is
 * mean + sum over k of weights[i, k] components[k]. As `apps/viewer/motion.py` writes them.
 */

import { floats } from "./half.js";

const LOOKED_AT = 32; // frames, spread evenly, that a largest value is found in

/**
 * The array of that name, or null: { frames, inner, kind, at }, `inner` the sides of a frame, at(frame) its numbers (of
 * kind "f2" as bit patterns). `sides` tells how many sides a frame has from those of the array. Throws Error.
 */
export function seriesOf(arrays, name, sides) {
  const found = arrays[name];
  if (found) {
    const { shape, kind, data } = found;
    const inner = shape.slice(-sides(shape));
    const frames = shape.length > inner.length ? shape[0] : 1;
    if (shape.length > inner.length + 1 || shape.length < inner.length)
      throw new Error(`its array ${name} has shape (${shape.join(", ")}), which fits nothing here`);
    const size = data.length / frames;
    const at = (frame) => {
      const start = Math.min(frame, frames - 1) * size;
      return data.subarray(start, start + size);
    };
    return { frames, inner, kind, at };
  }
  const [mean, components, weights] = ["mean", "components", "weights"].map((part) => arrays[`${name}_${part}`]);
  if (!mean || !components || !weights) return null;
  const [frames, count] = weights.shape;
  if (components.shape[0] !== count || components.data.length !== count * mean.data.length)
    throw new Error(`its components of ${name} do not fit together`);
  const at = (frame) => {
    const row = Math.min(frame, frames - 1);
    return combined(mean.data, components.data, weights.data.subarray(row * count, (row + 1) * count));
  };
  return { frames, inner: mean.shape, kind: "f4", at };
}

/** mean + sum over k of weights[k] components[k], in single precision. */
export function combined(mean, components, weights) {
  const size = mean.length;
  const sum = Float32Array.from(mean);
  for (let k = 0; k < weights.length; k++) {
    const [weight, start] = [weights[k], k * size];
    for (let i = 0; i < size; i++) sum[i] += weight * components[start + i];
  }
  return sum;
}

/** A frame of a series as plain numbers. */
export function numbersAt(series, frame) {
  const data = series.at(frame);
  return series.kind === "f2" ? floats({ kind: "f2", data }) : data;
}

/** Some of so many frames, spread evenly, the first and the last among them. */
export function someOf(frames) {
  const count = Math.min(frames, LOOKED_AT);
  return Array.from({ length: count }, (_, i) => Math.round((i * (frames - 1)) / Math.max(count - 1, 1)));
}
