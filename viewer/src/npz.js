/** `.npz` files in the browser: a zip archive of `.npy` arrays, stored or deflated, without pickle. */

const ENTRY = 0x02014b50;
const END = 0x06054b50;
const KINDS = {
  f2: Uint16Array, // bit patterns: see half.js
  f4: Float32Array,
  f8: Float64Array,
  i1: Int8Array,
  i2: Int16Array,
  i4: Int32Array,
  u1: Uint8Array,
  u2: Uint16Array,
  u4: Uint32Array,
};

/** Arrays by name, { shape, kind, data }, and `metadata` as an object. Throws Error with one line. */
export async function readNpz(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const arrays = {};
  for (const entry of entries(view)) {
    const name = entry.name.replace(/\.npy$/, "");
    arrays[name] = readNpy(await content(view, entry), name);
  }
  const text = arrays.metadata;
  delete arrays.metadata;
  try {
    return { arrays, metadata: text ? JSON.parse(text.data) : {} };
  } catch {
    throw new Error("its metadata is no JSON");
  }
}

function entries(view) {
  let end = view.byteLength - 22;
  while (end >= 0 && view.getUint32(end, true) !== END) end--;
  if (end < 0) throw new Error("it is no npz file, or only a part of one");
  let at = view.getUint32(end + 16, true);
  const found = [];
  for (let left = view.getUint16(end + 10, true); left > 0; left--) {
    if (at + 46 > view.byteLength || view.getUint32(at, true) !== ENTRY)
      throw new Error("its list of arrays is damaged");
    const [name, extra, comment] = [28, 30, 32].map((offset) => view.getUint16(at + offset, true));
    found.push({
      name: new TextDecoder().decode(new Uint8Array(view.buffer, view.byteOffset + at + 46, name)),
      deflated: view.getUint16(at + 10, true) === 8,
      size: view.getUint32(at + 20, true),
      start: view.getUint32(at + 42, true),
    });
    at += 46 + name + extra + comment;
  }
  return found;
}

async function content(view, { start, size, deflated, name }) {
  if (start + 30 > view.byteLength) throw new Error(`its array ${name} is cut off`);
  const head = start + 30 + view.getUint16(start + 26, true) + view.getUint16(start + 28, true);
  if (head + size > view.byteLength) throw new Error(`its array ${name} is cut off`);
  const packed = new Uint8Array(view.buffer, view.byteOffset + head, size);
  if (!deflated) return packed.slice();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  try {
    return new Uint8Array(await new Response(stream).arrayBuffer());
  } catch {
    throw new Error(`its array ${name} is damaged`);
  }
}

function readNpy(bytes, name) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 12 || view.getUint32(0) !== 0x934e554d) throw new Error(`${name} is no array of NumPy`);
  const long = bytes[6] > 1;
  const length = long ? view.getUint32(8, true) : view.getUint16(8, true);
  const start = (long ? 12 : 10) + length;
  const header = new TextDecoder().decode(bytes.subarray(long ? 12 : 10, start));
  const [, kind] = header.match(/'descr': '([^']+)'/) ?? [];
  const [, order] = header.match(/'fortran_order': (\w+)/) ?? [];
  const [, sides] = header.match(/'shape': \(([^)]*)\)/) ?? [];
  if (!kind || sides === undefined) throw new Error(`${name} is no plain array`);
  const shape = sides
    .split(",")
    .filter((side) => side.trim())
    .map(Number);
  const count = shape.reduce((a, b) => a * b, 1);
  if (/^<U\d+$/.test(kind)) return { shape, kind: "text", data: text(view, start, Number(kind.slice(2)) * count) };
  const Kind = KINDS[kind.slice(1)];
  if (!Kind || kind[0] === ">") throw new Error(`${name} holds ${kind}: write numbers, little-endian`);
  if (order === "True" && shape.length > 1) throw new Error(`${name} is in Fortran order: write it in C order`);
  if (start + count * Kind.BYTES_PER_ELEMENT > bytes.length) throw new Error(`its array ${name} is cut off`);
  return { shape, kind: kind.slice(1), data: new Kind(bytes.slice(start).buffer, 0, count) };
}

/** NumPy's text: four bytes for each letter, zeros at its end. */
function text(view, start, letters) {
  let found = "";
  for (let i = 0; i < letters; i++) {
    const code = view.getUint32(start + 4 * i, true);
    if (code) found += String.fromCodePoint(code);
  }
  return found;
}
