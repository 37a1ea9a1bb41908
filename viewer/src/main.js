/** The page: read its files, show them, listen. */

import { bindAddress, readAddress } from "./address.js";
import { bindFiles, openOwn } from "./files.js";
import { bindGestures } from "./gestures.js";
import { bindPanel, byId } from "./panel.js";
import { Picture } from "./picture.js";
import { bindPlayer } from "./player.js";
import { bindReadout } from "./readout.js";
import { Scene } from "./scene.js";

function say(text) {
  byId("message").textContent = text;
  byId("message").hidden = !text;
}

function follow(scene) {
  const canvas = byId("picture");
  const fit = () => {
    const sharpness = Math.min(devicePixelRatio, 2);
    scene.resize(
      Math.max(1, Math.round(canvas.clientWidth * sharpness)),
      Math.max(1, Math.round(canvas.clientHeight * sharpness)),
    );
  };
  new ResizeObserver(fit).observe(canvas);
  fit();
}

function save(scene) {
  scene.draw();
  byId("picture").toBlob((blob) => {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: "gash.png" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  });
}

async function start() {
  let picture;
  try {
    picture = new Picture(byId("picture"));
  } catch {
    byId("waiting").textContent =
      "error: this browser draws no WebGL 2: switch graphics acceleration on, or use another one";
    return;
  }
  const scene = new Scene(picture);
  const actions = {
    ...bindPlayer(scene),
    h: () => document.body.classList.toggle("bare"),
    t: () => byId("theme").click(),
    s: () => save(scene),
    "?": () => byId("about").showModal(),
  };
  bindPanel(scene);
  bindGestures(scene, actions);
  bindReadout(scene);
  bindFiles(scene, say);
  byId("save").addEventListener("click", () => save(scene));
  const notes = await openOwn(scene);
  byId("notes").replaceChildren(
    ...notes.map((note) => Object.assign(document.createElement("li"), { textContent: note })),
  );
  follow(scene);
  readAddress(scene);
  bindAddress(scene);
  scene.draw();
  byId("waiting").hidden = true;
  document.body.dataset.ready = "yes";
}

start().catch((error) => {
  byId("waiting").textContent = `error: this page cannot be shown: ${error.message}`;
});
