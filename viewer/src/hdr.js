/** Radiance pictures (.hdr): linear radiance, three numbers a pixel, top row first. As `formats.hdr` reads them. */

/** { width, height, pixels } of a latlong map. Throws Error with one line. */
export function readHdr(bytes) {
  const { width, height, scale, start } = header(bytes);
  const quads = new Uint8Array(width * height * 4);
  let at = start;
  for (let row = 0; row < height; row++)
    at = scanline(bytes, at, quads.subarray(row * width * 4, (row + 1) * width * 4));
  const pixels = new Float32Array(width * height * 3);
  for (let i = 0; i < width * height; i++) {
    const factor = quads[4 * i + 3] ? 2 ** (quads[4 * i + 3] - 136) : 0;
    for (let c = 0; c < 3; c++) pixels[3 * i + c] = (quads[4 * i + c] * factor) / scale[c];
  }
  return { width, height, pixels };
}

function header(bytes) {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, 4096));
  if (!/^#\?(RADIANCE|RGBE)/i.test(text)) throw new Error("it is no Radiance picture (.hdr)");
  const blank = text.match(/\r?\n[ \t]*\r?\n/);
  const size = blank && text.slice(blank.index + blank[0].length).match(/^-Y (\d+) \+X (\d+)[^\r\n]*\r?\n/);
  if (!size) throw new Error("its rows do not run from the top, left to right: write it again as -Y height +X width");
  const lines = text.slice(0, blank.index).split(/\r?\n/);
  if (lines.some((line) => /^FORMAT=(?!32-bit_rle_rgbe)/.test(line)))
    throw new Error("it is coded as something else than RGBE");
  // eight zeros stand in many maps and mean nothing
  if (lines.some((line) => /^PRIMARIES=.*[1-9]/.test(line))) {
    throw new Error("its header names PRIMARIES of its own: let gash view read it");
  }
  const scale = [1, 1, 1];
  for (const line of lines) {
    const [, values] = line.match(/^(?:EXPOSURE|COLORCORR)=(.*)$/) ?? [];
    const found = values?.trim().split(/\s+/).map(Number);
    for (let c = 0; found && c < 3; c++) scale[c] *= found[c] ?? found[0];
  }
  const [height, width] = size.slice(1).map(Number);
  if (width !== 2 * height)
    throw new Error(`it has ${width} x ${height} pixels: a latlong map is twice as wide as high`);
  if (!scale.every((value) => value > 0)) throw new Error("it has an EXPOSURE that is not above 0");
  return { width, height, scale, start: blank.index + blank[0].length + size[0].length };
}

/** Fill one line of pixels from whichever of the three codings it has; returns where the next one starts. */
function scanline(bytes, at, line) {
  const width = line.length / 4;
  if (at + 4 > bytes.length) throw new Error("its pixels end early");
  const coded = width >= 8 && width < 32768 && bytes[at] === 2 && bytes[at + 1] === 2 && bytes[at + 2] < 128;
  if (!coded) return oldLine(bytes, at, line);
  if (bytes[at + 2] * 256 + bytes[at + 3] !== width) throw new Error("its lines are not as long as it says");
  at += 4;
  for (let channel = 0; channel < 4; channel++) {
    for (let x = 0; x < width;) {
      const repeated = bytes[at] > 128;
      const count = repeated ? bytes[at] - 128 : bytes[at];
      if (!count || x + count > width || at + (repeated ? 1 : count) >= bytes.length)
        throw new Error("its pixels break");
      for (let i = 0; i < count; i++) line[4 * x++ + channel] = bytes[at + 1 + (repeated ? 0 : i)];
      at += 1 + (repeated ? 1 : count);
    }
  }
  return at;
}

/** Flat pixels, among which 1, 1, 1, n repeats the one before; following ones count 256 times as much. */
function oldLine(bytes, at, line) {
  let shift = 0;
  for (let x = 0; x < line.length;) {
    const quad = bytes.subarray(at, at + 4);
    if (quad.length < 4) throw new Error("its pixels end early");
    at += 4;
    if (quad[0] === 1 && quad[1] === 1 && quad[2] === 1) {
      const count = quad[3] << shift;
      if (x === 0 || x + 4 * count > line.length) throw new Error("its pixels break");
      for (let i = 0; i < count; i++, x += 4) line.copyWithin(x, x - 4, x);
      shift += 8;
    } else {
      line.set(quad, x);
      x += 4;
      shift = 0;
    }
  }
  return at;
}
