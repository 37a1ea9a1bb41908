/** The controls beside the picture: they show the state of the scene and change it. */

import { gradient } from "./palettes.js";
import { IDENTITY } from "./turns.js";

const BANDS = ["constant", "l = 1", "l = 2", "l = 3", "l = 4", "l = 5", "l = 6", "l = 7", "l = 8", "l = 9"];
export const byId = (id) => document.getElementById(id);

export function bindPanel(scene) {
  const number = (id, change) => byId(id).addEventListener("input", () => change(Number(byId(id).value)));
  const choice = (id, change) => byId(id).addEventListener("change", () => change(byId(id).value));
  choice("method", (value) => scene.set({ method: Number(value) }));
  choice("show", (show) => scene.set({ show }));
  choice("against", (value) => scene.set({ against: Number(value) }));
  choice("light", (value) => scene.set({ light: Number(value) }));
  choice("window", (value) => scene.set({ window: value }));
  choice("background", (background) => scene.set({ background }));
  choice("material", (material) => scene.set({ material }));
  number("coefficient", (coefficient) => scene.set({ coefficient }));
  number("stops", (stops) => scene.set({ stops }));
  number("width", (width) => scene.set({ width }));
  for (const kind of ["phong", "ggx"])
    number(kind, (value) => scene.set({ gloss: { ...scene.state.gloss, [kind]: value } }));
  byId("wire").addEventListener("change", () => scene.set({ wire: byId("wire").checked }));
  byId("reset").addEventListener("click", () => scene.set({ turn: IDENTITY, stops: 0 }));
  for (const button of byId("views").children) button.addEventListener("click", () => scene.look(button.dataset.view));
  bindTheme();
  byId("help").addEventListener("click", () => byId("about").showModal());
  scene.listeners.push(refresh);
}

function bindTheme() {
  const root = document.documentElement;
  if (!root.dataset.theme) root.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  byId("theme").addEventListener(
    "click",
    () => (root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark"),
  );
}

/** Show the state of the scene in the controls. */
function refresh(scene) {
  const { state, method, other } = scene;
  if (!method) return;
  const names = scene.methods.map((found) => found.name);
  options("method", names, state.method);
  options("against", names, state.against, (i) => scene.methods[i].bands !== method.bands);
  options(
    "light",
    scene.lights.map((light) => light.name),
    state.light,
  );
  for (const key of ["show", "window", "background", "material", "stops", "width", "coefficient"])
    setValue(key, state[key]);
  byId("wire").checked = state.wire;
  byId("coefficient").max = method.bands ** 2 - 1;
  byId("width").max = 2 * method.bands;
  const bare = new Set(["standard_error", "predicted_error"].filter((name) => !method.errors[name]));
  for (const option of byId("show").options) {
    option.hidden = option.disabled =
      bare.has(option.value) || (option.value === "difference" && scene.methods.length < 2);
  }
  const glossy = method.gloss && (state.show !== "difference" || other?.gloss);
  const shown = {
    "against-row": state.show === "difference",
    "coefficient-row": state.show === "coefficient",
    "width-row": state.window === "hann" || state.window === "lanczos",
    surface: Boolean(glossy),
    "phong-row": state.material === "phong",
    "ggx-row": state.material === "ggx",
  };
  for (const [id, visible] of Object.entries(shown)) byId(id).hidden = !visible;
  const l = Math.floor(Math.sqrt(state.coefficient));
  byId("band").value = l ? `${BANDS[l]}, m = ${state.coefficient - l * l - l}` : BANDS[0];
  byId("exposure").value = `x ${Number(scene.exposure.toPrecision(3))}`;
  byId("width-number").value = `l = ${state.width}`;
  for (const kind of ["phong", "ggx"]) {
    setValue(kind, state.gloss[kind]);
    byId(`${kind}-number`).value = state.gloss[kind];
  }
  byId("light").title = scene.lights[state.light]?.name ?? "";
  byId("background").options[1].disabled = !scene.lights[state.light]?.map;
  legend(scene);
}

function legend(scene) {
  const found = scene.legend();
  byId("legend").hidden = !found;
  if (!found) return;
  const limit = Number(found.limit.toPrecision(2));
  const difference = scene.state.show === "difference";
  byId("bar").style.background = gradient(found.palette);
  byId("low").textContent = found.palette === "rising" ? "0" : `-${limit}${difference ? " too dark" : ""}`;
  byId("middle").textContent = found.palette === "rising" ? "root mean square" : "0";
  byId("high").textContent = `${found.palette === "rising" ? "" : "+"}${limit}${difference ? " too bright" : ""}`;
}

/** The entries of a list, made anew only where they changed. */
function options(id, names, chosen, off = () => false) {
  const list = byId(id);
  if (list.length !== names.length || names.some((name, i) => list.options[i].textContent !== name)) {
    list.replaceChildren(
      ...names.map((name, i) => Object.assign(document.createElement("option"), { textContent: name, value: i })),
    );
  }
  for (const option of list.options) option.disabled = off(Number(option.value));
  setValue(id, chosen);
}

function setValue(id, value) {
  const control = byId(id);
  if (control !== document.activeElement || control.type !== "number") control.value = value;
}
