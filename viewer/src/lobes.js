/** Kernels by their factor in each band: clamped cosine, hemisphere, and lobes of gloss as in `light.brdf`. */

import { gaussLegendre } from "./sh.js";

const MIRROR = 1e-12;

/** C(n, n / 2) / 2^n for even n. */
function central(n) {
  let value = 1;
  for (let i = 1; i <= n / 2; i++) value *= (2 * i - 1) / (2 * i);
  return value;
}

/** A_l of max(n.w, 0) (Ramamoorthi & Hanrahan 2001, eq. 8). */
export function clampedCosine(l) {
  if (l === 1) return (2 * Math.PI) / 3;
  if (l % 2 === 1) return 0;
  return ((2 * Math.PI * (-1) ** (l / 2 - 1)) / ((l + 2) * (l - 1))) * central(l);
}

/** H_l of 1 for n.w > 0. */
export function hemisphere(l) {
  if (l % 2 === 0) return l === 0 ? 2 * Math.PI : 0;
  return (2 * Math.PI * (-1) ** ((l - 1) / 2) * central(l - 1)) / (l + 1);
}

/** Phong's lobe of the exponent s: from l to l + 2 times (s - l) / (s + l + 3). */
export function phong(s, bands) {
  const factors = [1, (s + 1) / (s + 2)];
  for (let l = 0; factors.length < bands; l++) factors.push((factors[l] * (s - l)) / (s + l + 3));
  return factors.slice(0, bands);
}

/** GGX at normal view with height-correlated masking, alpha = roughness². */
export function ggx(roughness, bands) {
  const square = Math.max(roughness ** 4, MIRROR);
  const growth = Math.log1p(1 / square);
  const factors = new Array(bands).fill(0);
  for (const [node, weight] of gaussLegendre(64)) {
    const step = (node + 1) / 2;
    const t = square * Math.expm1(step * growth);
    const cosine = (1 - t) / (1 + t);
    const masking = (2 * cosine) / (cosine + Math.sqrt(square + (1 - square) * cosine * cosine));
    const density = weight * Math.exp(-step * growth) * masking;
    let [before, value] = [0, 1];
    for (let l = 0; l < bands; l++) {
      factors[l] += density * value;
      [before, value] = [value, ((2 * l + 1) * cosine * value - l * before) / (l + 1)];
    }
  }
  return factors.map((factor) => factor / factors[0]);
}
