/** What is on the page and how it is looked at; every change ends in one picture at the next frame of the screen. */

import { Camera, VIEWS } from "./camera.js";
import { floats } from "./half.js";
import { ggx, phong } from "./lobes.js";
import { multiplier, rotateLight } from "./sh.js";
import { closedForm, COLOURED, GREY, limitOf, normalsAt, positions } from "./shapes.js";
import { IDENTITY, matrixOf } from "./turns.js";
import { factorsFor } from "./windows.js";

const SHOWN = ["light", "difference", "coefficient", "standard_error", "predicted_error"];
const FULL = 0.3; // difference, in shares of white, at which colours are full
const MEASURED = 256; // pixels a side of the picture that the exposure is chosen from
const [PERCENTILE, TARGET] = [0.98, 0.9];

export class Scene {
  constructor(picture) {
    this.picture = picture;
    this.camera = new Camera();
    this.mesh = null;
    this.methods = [];
    this.lights = [];
    this.listeners = [];
    this.size = [2, 2];
    this.automatic = 1;
    this.made = {};
    this.state = {
      method: 0,
      against: -1,
      show: "light",
      coefficient: 0,
      light: 0,
      turn: IDENTITY,
      stops: 0,
      window: "none",
      width: 3,
      material: "matte",
      gloss: { phong: 10, ggx: 0.4 },
      background: "ground",
      wire: false,
      frame: 0,
    };
  }

  /** Another mesh; methods are its own, with the closed form at the end where normals at its vertices say it. */
  setObject(mesh, methods) {
    this.picture.setMesh(mesh);
    this.mesh = mesh;
    this.made = {};
    const known = !mesh.side && normalsAt(mesh, 0).some((value) => value !== 0);
    const { bands } = methods[0];
    this.methods = known
      ? [
          ...methods,
          closedForm(
            mesh,
            bands,
            methods.some((method) => method.gloss),
          ),
        ]
      : methods;
    const against = this.methods.length > 1 ? 1 : -1;
    Object.assign(this.state, {
      method: 0,
      against,
      frame: 0,
      coefficient: 0,
      show: "light",
      material: "matte",
      width: bands,
    });
    this.look("front");
    this.expose();
  }

  /** One more result for the same mesh, before the closed form. */
  addMethod(method) {
    const end = this.methods.findIndex((found) => found.closed);
    this.methods.splice(end < 0 ? this.methods.length : end, 0, method);
    this.made = {};
    this.set({ method: this.methods.indexOf(method), against: 0, show: "light" });
  }

  addLight(light) {
    this.lights.push(light);
    this.set({ light: this.lights.length - 1 });
    if (this.mesh) this.expose();
  }

  /** Change some of the state, tell listeners, draw. */
  set(changes) {
    Object.assign(this.state, changes);
    this.repair();
    const brighter = ["light", "material", "gloss"].some((key) => key in changes);
    if (brighter && this.mesh && this.lights.length) this.expose();
    this.changed();
  }

  /** Undo what does not go together. */
  repair() {
    const { state } = this;
    if (!this.mesh) return;
    const { method, other } = this;
    state.coefficient = Math.max(0, Math.min(method.bands ** 2 - 1, state.coefficient));
    if (!method.gloss || (state.show === "difference" && !other?.gloss)) state.material = "matte";
    if (state.show.endsWith("_error") && !method.errors[state.show]) state.show = "light";
    if (state.show === "difference" && (!other || other.bands !== method.bands)) state.show = "light";
    state.frame = Math.max(0, Math.min(this.frames - 1, Math.round(state.frame)));
  }

  changed() {
    for (const listener of this.listeners) listener(this);
    this.request();
  }

  request() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = null;
      this.draw();
    });
  }

  get method() {
    return this.methods[this.state.method];
  }

  get other() {
    return this.methods[this.state.against];
  }

  /** What is subtracted from the result, if anything. */
  get subtracted() {
    return this.state.show === "difference" ? this.other : null;
  }

  get frames() {
    return Math.max(this.mesh.frames, this.method.frames);
  }

  get exposure() {
    return this.automatic * 2 ** this.state.stops;
  }

  get aspect() {
    return this.size[0] / this.size[1];
  }

  /** A view's name, or azimuth and elevation in degrees; the mesh fills the frame. */
  look(view) {
    this.place();
    const [azimuth, elevation] = Array.isArray(view) ? view : VIEWS[view];
    this.camera.frame(azimuth, elevation, this.points, this.mesh.used);
    this.changed();
  }

  resize(width, height) {
    this.size = [width, height];
    this.picture.resize(width, height);
    if (this.mesh) this.draw();
  }

  /** Choose the exposure as `gash render` does: the 98th percentile of the mesh's luminance becomes 0.9. */
  expose() {
    if (!this.lights.length) return;
    const { size, state } = this;
    this.state = { ...state, show: "light", wire: false };
    [this.size, this.automatic] = [[MEASURED, MEASURED], 2 ** -state.stops];
    this.picture.resize(MEASURED, MEASURED);
    this.draw();
    const samples = this.picture.read(0, 0, MEASURED, MEASURED);
    this.state = state;
    this.automatic = TARGET / Math.max(quantile(luminances(samples, 2 * MEASURED), PERCENTILE), 1e-9);
    this.resize(...size);
  }

  /** What every picture needs that was not made for the one before. */
  once(name, key, make) {
    const text = JSON.stringify(key);
    if (this.made[name] !== text) make();
    this.made[name] = text;
  }

  place() {
    const { mesh, state, picture } = this;
    this.once("place", [state.frame], () => {
      this.points = positions(mesh, state.frame);
      picture.setPositions(this.points, normalsAt(mesh, state.frame));
    });
  }

  /** The light as it shines now: turned and windowed, in the bands of the method. */
  light() {
    const { state, method } = this;
    const { coefficients } = this.lights[state.light];
    const turned = rotateLight(coefficients.slice(0, 3 * method.bands ** 2), matrixOf(state.turn));
    const factors = factorsFor(state, coefficients, method.bands);
    return turned.map((value, i) => value * factors[Math.floor(i / 3)]);
  }

  upload() {
    const { state, picture, method, mesh } = this;
    const glossy = state.material !== "matte";
    this.place();
    for (const [name, found] of Object.entries({ dataA: method, dataB: this.subtracted })) {
      if (!found) continue;
      const key = [this.methods.indexOf(found), glossy, state.frame];
      this.once(name, key, () => picture.setData(name, numbersOf(found, glossy, state.frame)));
    }
    this.once("lights", [state.light, state.turn, state.window, state.width, method.bands, glossy], () => {
      const light = this.light();
      picture.setTable("lights", light, light.length / 3);
      if (glossy) picture.setTable("products", multiplier(light), light.length / 3);
    });
    this.once("behind", [state.background, state.light, state.window, state.width], () => {
      const surroundings = this.lights[state.light].surroundings(state.background, this);
      if (surroundings) picture.setSurroundings(surroundings);
    });
    const errors = method.errors[state.show];
    if (errors) this.once("scalars", [state.show, state.method, mesh.count], () => picture.setData("scalars", errors));
  }

  /** Colours of what is shown: null for light, else { palette, limit, per }, per the factor before the limit. */
  legend() {
    const { show, coefficient } = this.state;
    if (show === "light") return null;
    if (show === "difference") return { palette: "signed", limit: FULL, per: this.exposure };
    const limit = limitOf(this.method, show === "coefficient" ? coefficient : show);
    return { palette: show === "coefficient" ? "signed" : "rising", limit, per: 1 };
  }

  draw() {
    if (!this.mesh || !this.lights.length) return;
    this.upload();
    const { state, method, subtracted, camera, aspect, exposure } = this;
    const legend = this.legend();
    const { matrix, eye } = camera.clip(aspect);
    const lobe = { matte: () => [], phong, ggx }[state.material](state.gloss[state.material], method.bands);
    const factors = new Float32Array(10);
    factors.set(lobe);
    this.scale = legend ? legend.per / legend.limit : exposure;
    this.picture.draw({
      clip: matrix,
      eye,
      wire: state.wire,
      surface: {
        kindA: kindOf(method, lobe.length),
        kindB: subtracted ? kindOf(subtracted, lobe.length) : 0,
        bands: method.bands,
        show: Math.min(SHOWN.indexOf(state.show), 3),
        chosen: state.coefficient,
        glossy: lobe.length > 0,
        factors,
        scale: this.scale,
      },
      finish: {
        palette: !legend ? 0 : legend.palette === "signed" ? 1 : 2,
        behind: state.background === "ground" ? 0 : 1,
        exposure,
        axes: transposed(camera.pose().axes.flat()),
        turn: transposed(matrixOf(state.turn)),
        frame: camera.window(aspect),
      },
    });
  }

  /** The value that is shown at a pixel from the upper left corner, or null beside the mesh. */
  valueAt(x, y) {
    const samples = this.picture.read(x, this.size[1] - 1 - y, 1, 1);
    let covered = 0;
    const sum = [0, 0, 0];
    for (let i = 0; i < samples.length; i += 4) {
      covered += samples[i + 3];
      for (let c = 0; c < 3; c++) sum[c] += samples[i + c];
    }
    return covered > 0 ? sum.map((value) => value / covered / this.scale) : null;
  }
}

function kindOf(method, glossy) {
  return glossy ? method.gloss.kind : method.coloured ? COLOURED : GREY;
}

/** The numbers of a method that a picture needs: bit patterns of halfs as they are. */
function numbersOf(method, glossy, frame) {
  const series = glossy ? method.gloss.series : method.coefficients;
  const data = series.at(frame);
  return series.kind === "f2" || series.kind === "f4" ? data : floats({ kind: series.kind, data });
}

function transposed(m) {
  return [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];
}

/** Mean of the colours of pixels that the mesh covers by more than half, from four samples each. */
function luminances(samples, side) {
  const found = [];
  for (let y = 0; y < side; y += 2) {
    for (let x = 0; x < side; x += 2) {
      const sum = [0, 0];
      for (const at of [0, 1, side, side + 1]) {
        const i = 4 * (y * side + x + at);
        sum[0] += (samples[i] + samples[i + 1] + samples[i + 2]) / 12;
        sum[1] += samples[i + 3] / 4;
      }
      if (sum[1] > 0.5) found.push(sum[0]);
    }
  }
  return found;
}

function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  const place = share * (sorted.length - 1);
  const below = Math.floor(place);
  const above = Math.min(below + 1, sorted.length - 1);
  return sorted.length ? sorted[below] + (place - below) * (sorted[above] - sorted[below]) : 1;
}
