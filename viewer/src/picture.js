/**
 * The picture: samples of radiance, four to a pixel, in half floats, then one pass that averages, exposes and colours
 * them. It knows textures and shaders; what they mean is in scene.js.
 */

import {
  BufferAttribute,
  BufferGeometry,
  Camera as NoCamera,
  ClampToEdgeWrapping,
  CustomBlending,
  DataTexture,
  DataUtils,
  DoubleSide,
  FloatType,
  GLSL3,
  HalfFloatType,
  LinearFilter,
  LineSegments,
  Matrix3,
  Matrix4,
  Mesh,
  NearestFilter,
  OneFactor,
  RawShaderMaterial,
  RepeatWrapping,
  RGBAFormat,
  Scene,
  SrcColorFactor,
  UnsignedByteType,
  Vector3,
  Vector4,
  WebGLRenderer,
  WebGLRenderTarget,
  ZeroFactor,
} from "three";

import { ramp } from "./palettes.js";
import { FINISH, FRAGMENT, LINES, LINES_VERTEX, SCREEN, TEXELS, TEXTURED, TEXTURED_VERTEX, VERTEX } from "./shader.js";

const SAMPLES = 2;
const WIDTH = 2048;

export class Picture {
  constructor(canvas) {
    this.renderer = new WebGLRenderer({ canvas, antialias: false, alpha: false, preserveDrawingBuffer: true });
    this.renderer.autoClear = false;
    this.renderer.setClearColor(0x000000, 0);
    this.target = plainTarget(2);
    this.texels = plainTarget(1);
    this.uniforms = surfaceUniforms(this.texels.texture);
    this.finish = finishUniforms(this.target.texture);
    const options = { glslVersion: GLSL3, uniforms: this.uniforms, side: DoubleSide };
    // behind the lines along its edges
    const offset = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    this.atVertices = new RawShaderMaterial({ ...options, ...offset, vertexShader: VERTEX, fragmentShader: FRAGMENT });
    this.textured = new RawShaderMaterial({
      ...options,
      ...offset,
      vertexShader: TEXTURED_VERTEX,
      fragmentShader: TEXTURED,
    });
    this.surface = new Mesh(new BufferGeometry(), this.atVertices);
    const darken = {
      blending: CustomBlending,
      blendSrc: ZeroFactor,
      blendDst: SrcColorFactor,
      blendSrcAlpha: ZeroFactor,
      blendDstAlpha: OneFactor,
    };
    this.lines = new LineSegments(
      new BufferGeometry(),
      new RawShaderMaterial({
        ...options,
        vertexShader: LINES_VERTEX,
        fragmentShader: LINES,
        ...darken,
        depthWrite: false,
      }),
    );
    this.scene = new Scene().add(this.surface, this.lines);
    this.screen = fullScreen(FINISH, this.finish);
    this.shading = fullScreen(TEXELS, this.uniforms);
    for (const drawn of [this.surface, this.lines, this.screen, this.shading]) drawn.frustumCulled = false;
    this.ramps = Object.fromEntries(["signed", "rising"].map((name) => [name, rampTexture(name)]));
  }

  /** Draw another mesh: its faces; positions and normals follow; `side` texels squared where `uv` says. */
  setMesh({ faces, count, names, uv, side }) {
    const geometry = new BufferGeometry();
    geometry.setIndex(new BufferAttribute(faces, 1));
    for (const name of ["position", "normal"])
      geometry.setAttribute(name, new BufferAttribute(new Float32Array(3 * count), 3));
    if (uv) geometry.setAttribute("uv", new BufferAttribute(uv, 2));
    this.surface.material = uv ? this.textured : this.atVertices;
    if (side > this.renderer.capabilities.maxTextureSize)
      throw new Error("it has more texels than this graphics card holds");
    this.uniforms.side.value = side;
    this.texels.setSize(side || 1, side || 1);
    this.names = names;
    this.surface.geometry.dispose();
    this.surface.geometry = geometry;
    this.lines.geometry.dispose();
    this.lines.geometry = new BufferGeometry();
  }

  /** Lines along the edges, made when they are first seen: of a large mesh that takes a moment. */
  makeLines() {
    const { index, attributes } = this.surface.geometry;
    this.lines.geometry.setIndex(new BufferAttribute(edgesOf(index.array, this.names), 1));
    this.lines.geometry.setAttribute("position", attributes.position);
  }

  setPositions(positions, normals) {
    for (const [name, values] of Object.entries({ position: positions, normal: normals })) {
      const attribute = this.surface.geometry.getAttribute(name);
      attribute.array.set(values);
      attribute.needsUpdate = true;
    }
  }

  /** Put numbers, floats or bit patterns of halfs, into the texture of that name. */
  setData(name, numbers) {
    const half = numbers instanceof Uint16Array;
    const rows = Math.ceil(numbers.length / (4 * WIDTH)) || 1;
    if (rows > this.renderer.capabilities.maxTextureSize)
      throw new Error("it has more numbers than this graphics card holds");
    let texture = this.uniforms[name].value;
    const length = 4 * WIDTH * rows;
    if (!texture || texture.image.data.length !== length || (texture.type === HalfFloatType) !== half) {
      texture?.dispose();
      const data = half ? new Uint16Array(length) : new Float32Array(length);
      texture = plainTexture(data, WIDTH, rows, half ? HalfFloatType : FloatType);
      this.uniforms[name].value = texture;
    }
    texture.image.data.set(numbers);
    texture.needsUpdate = true;
  }

  /** Put triples, `width` in a row, into the texture of that name. */
  setTable(name, triples, width) {
    const height = triples.length / 3 / width;
    const data = new Float32Array(4 * width * height);
    for (let i = 0; i < width * height; i++) for (let c = 0; c < 3; c++) data[4 * i + c] = triples[3 * i + c];
    this.uniforms[name].value?.dispose();
    this.uniforms[name].value = plainTexture(data, width, height, FloatType);
  }

  /** Show a latlong map, halfs as bit patterns, behind the mesh. */
  setSurroundings({ width, height, halfs }) {
    const data = new Uint16Array(4 * width * height);
    for (let i = 0; i < width * height; i++) for (let c = 0; c < 3; c++) data[4 * i + c] = halfs[3 * i + c];
    this.finish.surroundings.value?.dispose();
    const texture = plainTexture(data, width, height, HalfFloatType);
    [texture.wrapS, texture.wrapT] = [RepeatWrapping, ClampToEdgeWrapping];
    texture.minFilter = texture.magFilter = LinearFilter;
    this.finish.surroundings.value = texture;
  }

  resize(width, height) {
    this.renderer.setSize(width, height, false);
    this.target.setSize(width * SAMPLES, height * SAMPLES);
  }

  /** Draw: `surface` and `finish` are uniforms by name, matrices as flat arrays. */
  draw({ surface, finish, clip, eye, wire }) {
    assign(this.uniforms, surface);
    this.uniforms.clip.value.fromArray(clip);
    this.uniforms.eye.value.fromArray(eye);
    assign(this.finish, { ...finish, axes: null, turn: null, frame: null, ramp: null });
    this.finish.axes.value.set(...finish.axes);
    this.finish.turn.value.set(...finish.turn);
    this.finish.frame.value.fromArray(finish.frame);
    this.finish.ramp.value = this.ramps[finish.palette === 2 ? "rising" : "signed"];
    this.lines.visible = wire;
    if (wire && !this.lines.geometry.index) this.makeLines();
    if (this.surface.material === this.textured) this.pass(this.texels, this.shading);
    this.pass(this.target, this.scene);
    this.pass(null, this.screen);
  }

  pass(target, drawn) {
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.renderer.render(drawn, new NoCamera());
  }

  /** Samples of a part of the last picture, in its own pixels from the lower left corner: four numbers each. */
  read(x, y, width, height) {
    const size = SAMPLES * SAMPLES * width * height * 4;
    const halfs = new Uint16Array(size);
    const place = [x, y, width, height].map((value) => value * SAMPLES);
    this.renderer.readRenderTargetPixels(this.target, ...place, halfs);
    return Float32Array.from(halfs, DataUtils.fromHalfFloat);
  }
}

/** Edges of faces, each once, as pairs of corners; corners of one name are one vertex. */
function edgesOf(faces, names) {
  const seen = new Set();
  const pairs = [];
  for (let f = 0; f < faces.length; f += 3) {
    for (let i = 0; i < 3; i++) {
      const ends = [faces[f + i], faces[f + ((i + 1) % 3)]];
      const [a, b] = ends.map((corner) => names[corner]).sort((one, other) => one - other);
      const key = a * 2 ** 26 + b;
      if (!seen.has(key)) pairs.push(...ends);
      seen.add(key);
    }
  }
  return Uint32Array.from(pairs);
}

function plainTexture(data, width, height, type) {
  const texture = new DataTexture(data, width, height, RGBAFormat, type);
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

function plainTarget(side) {
  return new WebGLRenderTarget(side, side, {
    type: HalfFloatType,
    minFilter: NearestFilter,
    magFilter: NearestFilter,
  });
}

function rampTexture(name) {
  const bytes = ramp(name);
  const texture = plainTexture(bytes, bytes.length / 4, 1, UnsignedByteType);
  texture.minFilter = texture.magFilter = LinearFilter;
  return texture;
}

function surfaceUniforms(texels) {
  const textures = ["dataA", "dataB", "lights", "products", "scalars"];
  const numbers = { kindA: 0, kindB: 0, bands: 1, show: 0, chosen: 0, glossy: false, scale: 1, side: 0 };
  return {
    ...Object.fromEntries(textures.map((name) => [name, { value: null }])),
    ...Object.fromEntries(Object.entries(numbers).map(([name, value]) => [name, { value }])),
    clip: { value: new Matrix4() },
    eye: { value: new Vector3() },
    texels: { value: texels },
    factors: { value: new Float32Array(10) },
  };
}

function finishUniforms(samples) {
  return {
    samples: { value: samples },
    surroundings: { value: null },
    ramp: { value: null },
    palette: { value: 0 },
    behind: { value: 0 },
    exposure: { value: 1 },
    axes: { value: new Matrix3() },
    turn: { value: new Matrix3() },
    frame: { value: new Vector4() },
  };
}

function fullScreen(fragmentShader, uniforms) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
  const material = new RawShaderMaterial({
    glslVersion: GLSL3,
    uniforms,
    vertexShader: SCREEN,
    fragmentShader,
    depthTest: false,
  });
  return new Mesh(geometry, material);
}

function assign(uniforms, values) {
  for (const [name, value] of Object.entries(values)) if (value !== null) uniforms[name].value = value;
}
