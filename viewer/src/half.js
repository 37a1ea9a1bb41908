/** 16-bit floats as bit patterns: NumPy writes them, textures take them, JavaScript has no array of them everywhere. */

const WIDE = new Float32Array(1);
const BITS = new Uint32Array(WIDE.buffer);

/** The number of a bit pattern. */
export function fromHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}

/** The nearest pattern of a number, at most the largest finite one. */
export function toHalf(value) {
  WIDE[0] = Math.max(-65504, Math.min(65504, value));
  const bits = BITS[0];
  const sign = (bits >>> 16) & 0x8000;
  const exponent = ((bits >>> 23) & 255) - 112;
  if (exponent <= 0) return sign | Math.round(Math.abs(WIDE[0]) * 2 ** 24);
  return sign | (((exponent << 10) | ((bits >>> 13) & 1023)) + ((bits >>> 12) & 1));
}

/** Numbers of an array that npz.js read. */
export function floats({ kind, data }) {
  return kind === "f2" ? Float32Array.from(data, fromHalf) : Float32Array.from(data);
}
