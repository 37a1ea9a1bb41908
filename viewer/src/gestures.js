/** Mouse, touch and keys on the picture: turn, turn the light, move, zoom. */

import { VIEWS } from "./camera.js";
import { byId } from "./panel.js";
import { about, after, IDENTITY } from "./turns.js";

const DEGREES = 180; // for a drag over half of the shorter side
const STEP = 5; // degrees of an arrow key
const WHEEL = 0.0015;

export function bindGestures(scene, actions) {
  const canvas = byId("picture");
  const fingers = new Map();
  let turnsLight = false;
  const choose = (light) => {
    turnsLight = light;
    byId("drag-view").setAttribute("aria-pressed", String(!light));
    byId("drag-light").setAttribute("aria-pressed", String(light));
  };
  byId("drag-view").addEventListener("click", () => choose(false));
  byId("drag-light").addEventListener("click", () => choose(true));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before || !scene.mesh) return;
    if (fingers.size > 1) pinch(scene, canvas, [...fingers.values()].slice(0, 2), event);
    else drag(scene, canvas, before, event, turnsLight);
    fingers.set(event.pointerId, event);
  });
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      scene.camera.zoom(Math.exp(event.deltaY * WHEEL), place(canvas, event), scene.aspect);
      scene.changed();
    },
    { passive: false },
  );
  document.addEventListener("keydown", (event) => {
    const typing = ["INPUT", "SELECT", "BUTTON"].includes(event.target.tagName) && event.target.type !== "range";
    if (typing || byId("about").open || event.ctrlKey || event.metaKey || !scene.mesh) return;
    if (event.target.type === "range" && event.key.startsWith("Arrow")) return;
    if (press(scene, event, actions)) event.preventDefault();
  });
}

/** Where a pointer is in the picture, both sides from -1 to 1, up and right. */
export function place(canvas, event) {
  const box = canvas.getBoundingClientRect();
  return [((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2];
}

function drag(scene, canvas, before, event, turnsLight) {
  const moved = place(canvas, event).map((value, i) => value - place(canvas, before)[i]);
  if (event.buttons === 4 || event.altKey) {
    scene.camera.pan(...moved, scene.aspect);
    scene.changed();
    return;
  }
  const short = Math.min(canvas.clientWidth, canvas.clientHeight);
  const [right, up] = [moved[0] * canvas.clientWidth, moved[1] * canvas.clientHeight].map(
    (pixels) => (pixels / short / 2) * DEGREES,
  );
  if (turnsLight || event.shiftKey || event.buttons === 2) turnLight(scene, right, up);
  else {
    scene.camera.turn(right, -up);
    scene.changed();
  }
}

/** Light that comes from the viewer's side follows the pointer. */
function turnLight(scene, right, up) {
  const [across] = scene.camera.pose().axes;
  const turn = after(about([0, 1, 0], right), scene.state.turn);
  scene.set({ turn: after(about(across, -up), turn) });
}

function pinch(scene, canvas, fingers, event) {
  const now = fingers.map((finger) => (finger.pointerId === event.pointerId ? event : finger));
  const [before, later] = [fingers, now].map((pair) => pair.map((finger) => place(canvas, finger)));
  const middle = ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  const apart = ([a, b]) => Math.hypot((a[0] - b[0]) * scene.aspect, a[1] - b[1]) || 1e-3;
  const [from, to] = [middle(before), middle(later)];
  scene.camera.pan(to[0] - from[0], to[1] - from[1], scene.aspect);
  scene.camera.zoom(apart(before) / apart(later), to, scene.aspect);
  scene.changed();
}

function press(scene, event, actions) {
  const { state } = scene;
  const arrows = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP] };
  const arrow = arrows[event.key];
  if (arrow && event.shiftKey) turnLight(scene, ...arrow);
  else if (arrow) {
    scene.camera.turn(arrow[0], -arrow[1]);
    scene.changed();
  }
  const view = Object.keys(VIEWS)[Number(event.key) - 1];
  if (view) scene.look(view);
  const next = (key, count) => scene.set({ [key]: (state[key] + 1) % count });
  const toggle = (show) => scene.set({ show: state.show === show ? "light" : show });
  const keys = {
    m: () => next("method", scene.methods.length),
    l: () => next("light", scene.lights.length),
    d: () => toggle("difference"),
    c: () =>
      scene.set(
        state.show === "coefficient"
          ? { coefficient: (state.coefficient + 1) % scene.method.bands ** 2 }
          : { show: "coefficient" },
      ),
    e: () => toggle(scene.method.errors.standard_error ? "standard_error" : "predicted_error"),
    b: () => scene.set({ background: { ground: "map", map: "bands", bands: "ground" }[state.background] }),
    w: () => scene.set({ wire: !state.wire }),
    0: () => scene.set({ turn: IDENTITY, stops: 0 }),
    "[": () => scene.set({ stops: Math.max(-6, state.stops - 0.25) }),
    "]": () => scene.set({ stops: Math.min(6, state.stops + 0.25) }),
    "+": () => scene.camera.zoom(1 / 1.1) ?? scene.changed(),
    "=": () => scene.camera.zoom(1 / 1.1) ?? scene.changed(),
    "-": () => scene.camera.zoom(1.1) ?? scene.changed(),
    ...actions,
  };
  const action = keys[event.key.toLowerCase()];
  action?.();
  return Boolean(arrow || view || action);
}
