/** Turns of the light as unit quaternions [w, x, y, z]. */

export const IDENTITY = [1, 0, 0, 0];

/** A turn by degrees about an axis of length 1. */
export function about([x, y, z], degrees) {
  const half = (degrees * Math.PI) / 360;
  const s = Math.sin(half);
  return [Math.cos(half), s * x, s * y, s * z];
}

/** First b, then a. */
export function after(a, b) {
  const product = [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
  const length = Math.hypot(...product);
  return product.map((value) => value / length);
}

/** The rotation matrix, row by row. */
export function matrixOf([w, x, y, z]) {
  return [
    1 - 2 * (y * y + z * z),
    2 * (x * y - w * z),
    2 * (x * z + w * y),
    2 * (x * y + w * z),
    1 - 2 * (x * x + z * z),
    2 * (y * z - w * x),
    2 * (x * z - w * y),
    2 * (y * z + w * x),
    1 - 2 * (x * x + y * y),
  ];
}

/** "90" is degrees about +y; "w,x,y,z" a quaternion; null for anything else. */
export function parseTurn(text) {
  const numbers = text.split(",").map(Number);
  if (!numbers.every(Number.isFinite)) return null;
  if (numbers.length === 1) return about([0, 1, 0], numbers[0]);
  const length = Math.hypot(...numbers);
  return numbers.length === 4 && length > 0 ? numbers.map((value) => value / length) : null;
}
