/** What is opened: the page's own files, and those that a visitor drops or chooses. */

import { readExr } from "./exr.js";
import { readHdr } from "./hdr.js";
import { lightOfMap, readLight } from "./lights.js";
import { readNpz } from "./npz.js";
import { byId } from "./panel.js";
import { readMesh, readMethod } from "./shapes.js";

/** The files in the page, base64 in the order in which they were written, to the scene; returns the notes. */
export async function openOwn(scene) {
  const notes = [];
  const transfers = [];
  for (const element of document.querySelectorAll("script[type='application/x-npz']")) {
    const response = await fetchLocal(element.textContent);
    element.remove();
    const file = await readNpz(response);
    notes.push(...(file.metadata.notes ?? []));
    if (element.dataset.kind === "light") scene.lights.push(readLight(file, element.dataset.name));
    else transfers.push([file, element.dataset.name]);
  }
  const mesh = readMesh(transfers[0][0]);
  scene.setObject(
    mesh,
    transfers.map(([file, name]) => readMethod(file, name, mesh)),
  );
  return notes;
}

/** Bytes of base64, without asking the network. */
async function fetchLocal(text) {
  const letters = atob(text.trim());
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

export function bindFiles(scene, say) {
  const open = async (files) => {
    for (const file of files) {
      try {
        await openFile(scene, file.name, new Uint8Array(await file.arrayBuffer()));
        say("");
      } catch (error) {
        say(`error: ${file.name} cannot be shown: ${error.message}`);
      }
    }
  };
  byId("open").addEventListener("click", () => byId("file").click());
  byId("file").addEventListener("change", () => open(byId("file").files).then(() => (byId("file").value = "")));
  const over = (shown) => (event) => {
    event.preventDefault();
    byId("drop").hidden = !shown;
  };
  document.addEventListener("dragover", over(true));
  document.addEventListener("dragleave", (event) => event.relatedTarget === null && over(false)(event));
  document.addEventListener("drop", (event) => {
    over(false)(event);
    open(event.dataTransfer.files);
  });
}

async function openFile(scene, name, bytes) {
  if (/\.hdr$/i.test(name)) return addLight(scene, lightOfMap(readHdr(bytes), name));
  if (/\.exr$/i.test(name)) return addLight(scene, lightOfMap(readExr(bytes), name));
  if (!/\.npz$/i.test(name)) throw new Error("use an .hdr or .exr map, or an .npz that gash wrote");
  const file = await readNpz(bytes);
  const { coefficients, faces } = file.arrays;
  if (coefficients && !faces) return addLight(scene, readLight(file, name));
  const mesh = readMesh(file);
  const method = readMethod(file, name, mesh);
  if (scene.lights.every((light) => light.bands < method.bands)) {
    throw new Error(
      `it has ${method.bands} bands, more than any light of this page: write a page of it with gash view`,
    );
  }
  return sameMesh(mesh, scene.mesh) ? scene.addMethod(method) : scene.setObject(mesh, [method]);
}

function addLight(scene, light) {
  if (scene.method && light.bands < scene.method.bands) {
    throw new Error(
      `it holds ${light.bands} bands, ${scene.method.bands} are needed: project its map again with as many`,
    );
  }
  scene.addLight(light);
}

function sameMesh(one, other) {
  if (
    !other ||
    one.count !== other.count ||
    one.side !== other.side ||
    one.frames !== other.frames ||
    one.faces.length !== other.faces.length
  )
    return false;
  const same = (name) => one[name].every((value, i) => value === other[name][i]);
  return same("names") && same("faces") && (!one.side || same("uv")) && one.box.size === other.box.size;
}
