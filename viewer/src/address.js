/**
 * What the address says after #, and what it is told: view=front or azimuth,elevation in degrees; rotate=90 or w,x,y,z;
 * exposure; method, against, light, frame as numbers from 0; show; coefficient; window=hann:3 or window=radiance;
 * material=phong:10; background; wire=1; panel=off; theme=dark. Words that mean nothing are passed over.
 */

import { VIEWS } from "./camera.js";
import { byId } from "./panel.js";
import { IDENTITY, parseTurn } from "./turns.js";

const NUMBERS = ["method", "against", "light", "frame", "coefficient"];
const DELAY = 300; // milliseconds after the last change

/** Do what the address says. */
export function readAddress(scene) {
  const said = new URLSearchParams(location.hash.slice(1));
  const { state } = scene;
  const changes = {};
  const counts = {
    method: scene.methods.length,
    against: scene.methods.length,
    light: scene.lights.length,
    frame: Infinity,
    coefficient: Infinity,
  };
  for (const name of NUMBERS) {
    const value = Number(said.get(name) ?? NaN);
    if (Number.isInteger(value) && value >= 0 && value < counts[name]) changes[name] = value;
  }
  const within = (id, value) => [...byId(id).options].some((option) => option.value === value);
  for (const name of ["show", "background"]) if (within(name, said.get(name))) changes[name] = said.get(name);
  const [kind, width] = (said.get("window") ?? "").split(":");
  if (within("window", kind))
    Object.assign(changes, { window: kind, width: Number(width) > 0 ? Number(width) : state.width });
  const [material, gloss] = (said.get("material") ?? "").split(":");
  if (within("material", material)) {
    changes.material = material;
    if (material !== "matte" && Number(gloss) >= 0) changes.gloss = { ...state.gloss, [material]: Number(gloss) };
  }
  const turn = said.has("rotate") && parseTurn(said.get("rotate"));
  if (turn) changes.turn = turn;
  if (said.has("wire")) changes.wire = said.get("wire") === "1";
  document.body.classList.toggle("bare", said.get("panel") === "off");
  if (["dark", "light"].includes(said.get("theme"))) document.documentElement.dataset.theme = said.get("theme");
  scene.set(changes);
  const exposure = Number(said.get("exposure"));
  if (exposure > 0) scene.set({ stops: Math.log2(exposure / scene.automatic) });
  const view = said.get("view");
  if (view in VIEWS) scene.look(view);
  const angles = (view ?? "").split(",").map(Number);
  if (angles.length === 2 && angles.every(Number.isFinite) && Math.abs(angles[1]) < 90) scene.look(angles);
}

/** Keep the address up to date. */
export function bindAddress(scene) {
  let timer = null;
  let written = location.hash;
  scene.listeners.push(() => {
    clearTimeout(timer);
    timer = setTimeout(() => {
      written = `#${words(scene)}`;
      try {
        history.replaceState(null, "", written);
      } catch {
        // a page inside a notebook has no address of its own
      }
    }, DELAY);
  });
  addEventListener("hashchange", () => location.hash !== written && readAddress(scene));
}

function words(scene) {
  const { state, camera } = scene;
  const round = (value) => Number(value.toFixed(3));
  const said = {
    view: `${round(camera.azimuth)},${round(camera.elevation)}`,
    ...Object.fromEntries([...NUMBERS, "show", "background"].map((name) => [name, state[name]])),
    rotate: state.turn === IDENTITY ? 0 : state.turn.map(round).join(","),
    exposure: Number(scene.exposure.toPrecision(6)),
    window: ["hann", "lanczos"].includes(state.window) ? `${state.window}:${state.width}` : state.window,
    material: state.material === "matte" ? "matte" : `${state.material}:${state.gloss[state.material]}`,
    wire: Number(state.wire),
  };
  if (document.body.classList.contains("bare")) said.panel = "off";
  return Object.entries(said)
    .map(([name, value]) => `${name}=${value}`)
    .join("&");
}
