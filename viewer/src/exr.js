/**
 * OpenEXR pictures (.exr): linear radiance, three numbers a pixel, top row first, as `formats.exr` reads them. Pixels are
 * unpacked by three.js; what the header asks for beyond plain R, G, B or Y in Rec. 709 is refused, and left to gash view.
 */

import { FloatType } from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";

const [MAGIC, DEEP, PARTS] = [20000630, 8, 16];
const REC_709 = [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329];
const SAME = 1e-3; // difference up to which primaries are those of Rec. 709
const NEGATIVE_SHARE = 0.01; // of the light, below which negative values are read as 0
const MOST_PIXELS = 2 ** 28;
const HALF_OR_FLOAT = [1, 2];

/** { width, height, pixels } of a latlong map. Throws Error with one line. */
export function readExr(bytes) {
  const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  const attributes = header(new DataView(buffer));
  check(attributes);
  let found;
  try {
    found = new EXRLoader().setDataType(FloatType).parse(buffer);
  } catch {
    throw new Error("its pixels end or break early");
  }
  const { width, height, data } = found;
  const pixels = new Float32Array(width * height * 3);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      // the loader gives the lowest row first
      const from = 4 * ((height - 1 - y) * width + x);
      for (let c = 0; c < 3; c++) pixels[3 * (y * width + x) + c] = data[from + c];
    }
  }
  return { width, height, pixels: withoutNegatives(pixels) };
}

/** Type and place of every attribute of the only part, before anything is unpacked. */
function header(view) {
  if (view.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new Error("it is no OpenEXR picture (.exr)");
  const flags = view.getUint8(5);
  if (flags & (DEEP | PARTS)) throw new Error("it has several parts or deep pixels: let gash view read it");
  const attributes = { view };
  let at = 8;
  const word = () => {
    let text = "";
    while (at < view.byteLength && view.getUint8(at)) text += String.fromCharCode(view.getUint8(at++));
    at++;
    return text;
  };
  try {
    for (let name = word(); name; name = word()) {
      const type = word();
      const size = view.getUint32(at, true);
      attributes[name] = { type, start: at + 4, size };
      at += 4 + size;
      if (at >= view.byteLength) throw new RangeError();
    }
  } catch {
    throw new Error("its header is cut off");
  }
  return attributes;
}

function check({ view, ...attributes }) {
  const { channels, dataWindow, displayWindow, chromaticities, envmap, compression } = attributes;
  if (channels?.type !== "chlist" || dataWindow?.type !== "box2i" || displayWindow?.type !== "box2i" || !compression)
    throw new Error("its header makes no sense");
  const list = channelsOf(view, channels);
  const named = (name) => list.find((channel) => channel.name === name);
  const chosen = ["R", "G", "B"].every(named) ? ["R", "G", "B"].map(named) : [named("Y")];
  if (!chosen[0] || named("RY") || named("BY")) throw new Error("it has no plain R, G, B or Y: let gash view read it");
  const plain = list.every(({ type, steps }) => type === chosen[0].type && steps === "1,1");
  if (!plain || !HALF_OR_FLOAT.includes(chosen[0].type))
    throw new Error("its channels are not all half or all float at full resolution: let gash view read it");
  const [data, display] = [dataWindow, displayWindow].map(({ start }) =>
    [0, 4, 8, 12].map((offset) => view.getInt32(start + offset, true)),
  );
  if (data.join() !== display.join()) throw new Error("it shows a part of its pixels: let gash view read it");
  const [width, height] = [data[2] - data[0] + 1, data[3] - data[1] + 1];
  if (!(width > 0 && height > 0 && width * height <= MOST_PIXELS))
    throw new Error(`it has ${width} x ${height} pixels: use a smaller map`);
  if (envmap && view.getUint8(envmap.start) === 1) throw new Error("it is a cube map: convert it to a latlong map");
  if (width !== 2 * height)
    throw new Error(`it has ${width} x ${height} pixels: a latlong map is twice as wide as high`);
  const colours = chromaticities && REC_709.map((_, i) => view.getFloat32(chromaticities.start + 4 * i, true));
  if (chosen.length === 3 && colours?.some((value, i) => !(Math.abs(value - REC_709[i]) <= SAME)))
    throw new Error("its header names primaries of its own: let gash view read it");
}

/** Channels by name: 0 whole numbers, 1 half, 2 float, and how many pixels one value stands for. */
function channelsOf(view, { start, size }) {
  const list = [];
  let at = start;
  while (at < start + size - 17) {
    let name = "";
    while (view.getUint8(at)) name += String.fromCharCode(view.getUint8(at++));
    const [type, right, down] = [1, 9, 13].map((offset) => view.getInt32(at + offset, true));
    list.push({ name, type, steps: `${right},${down}` });
    at += 17;
  }
  return list;
}

/** Few negative values, of a picture in a wide gamut or sharpened, are read as 0. */
function withoutNegatives(pixels) {
  let [light, lack] = [0, 0];
  for (const value of pixels) {
    if (value < 0) lack -= value;
    else light += value;
  }
  if (lack > 0 && lack >= NEGATIVE_SHARE * light) throw new Error("it holds radiance that is negative");
  return lack > 0 ? pixels.map((value) => Math.max(value, 0)) : pixels;
}
