/** Play, pause, step and slide through the frames of an animation. */

import { byId } from "./panel.js";

export function bindPlayer(scene) {
  let started = null; // time and frame at which playing began
  const step = (now) => {
    if (!started) return;
    const passed = Math.floor(((now - started.time) / 1000) * Number(byId("fps").value || 1));
    const frame = (started.frame + passed) % scene.frames;
    if (frame !== scene.state.frame) scene.set({ frame });
    requestAnimationFrame(step);
  };
  const play = (on) => {
    started = on && scene.frames > 1 ? { time: performance.now(), frame: scene.state.frame } : null;
    byId("play").textContent = started ? "❚❚" : "▶";
    byId("play").setAttribute("aria-label", started ? "Pause" : "Play");
    if (started) requestAnimationFrame(step);
  };
  const stop = (frame) => {
    play(false);
    scene.set({ frame: (frame + scene.frames) % scene.frames });
  };
  byId("play").addEventListener("click", () => play(!started));
  byId("frame").addEventListener("input", () => stop(Number(byId("frame").value)));
  byId("fps").addEventListener("input", () => play(Boolean(started)));
  scene.listeners.push(() => {
    const moving = Boolean(scene.mesh) && scene.frames > 1;
    document.body.classList.toggle("moving", moving);
    byId("player").hidden = !moving;
    if (!moving) return play(false);
    byId("frame").max = scene.frames - 1;
    byId("frame").value = scene.state.frame;
    byId("frame-number").value = `${scene.state.frame + 1} of ${scene.frames}`;
  });
  return {
    " ": () => play(!started),
    ",": () => stop(scene.state.frame - 1),
    ".": () => stop(scene.state.frame + 1),
  };
}
