/** Colours of numbers: blue, white, red about zero as in the pictures of gash; viridis (CC0) from zero up. */

const SIGNED = [
  [33, 102, 172],
  [247, 247, 247],
  [178, 24, 43],
];
const RISING = ["440154", "482878", "3e4a89", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"].map(
  (hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)),
);
export const STOPS = { signed: SIGNED, rising: RISING };
const STEPS = 257;

/** RGBA bytes of a ramp, from its lower to its upper end. */
export function ramp(name) {
  const stops = STOPS[name];
  const bytes = new Uint8Array(4 * STEPS);
  for (let i = 0; i < STEPS; i++) {
    const place = (i / (STEPS - 1)) * (stops.length - 1);
    const below = Math.min(Math.floor(place), stops.length - 2);
    const color = stops[below].map((value, c) => value + (place - below) * (stops[below + 1][c] - value));
    bytes.set([...color.map(Math.round), 255], 4 * i);
  }
  return bytes;
}

/** The ramp as CSS, for a colour bar. */
export function gradient(name) {
  return `linear-gradient(to right, ${STOPS[name].map((stop) => `rgb(${stop.join(" ")})`).join(", ")})`;
}
