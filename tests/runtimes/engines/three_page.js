/** What three.js shades with gash_three.js and the shaders: one number for each vertex, read back as floats. */

import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

import { harmonics, lightMesh, lightOfProbe, turnLight } from "/engines/gash_three.js";

const WIDTH = 64;
const renderer = new THREE.WebGLRenderer();
const text = async (path) => (await fetch(path)).text();

async function meshesOf(asset) {
  const scene = (await new GLTFLoader().loadAsync(asset)).scene;
  const meshes = [];
  scene.traverse((object) => object.isMesh && meshes.push(object));
  return { scene, meshes };
}

/** The mesh's vertices as triangles that cover the middle of one pixel each, in order. */
function dots(mesh) {
  const { attributes } = mesh.geometry;
  const count = attributes.position.count;
  const geometry = new THREE.BufferGeometry();
  for (const [name, { array, itemSize, normalized }] of Object.entries(attributes)) {
    const copies = new array.constructor(3 * array.length);
    for (let i = 0; i < count; i++)
      for (let corner = 0; corner < 3; corner++)
        for (let c = 0; c < itemSize; c++) copies[(3 * i + corner) * itemSize + c] = array[i * itemSize + c];
    geometry.setAttribute(name, new THREE.BufferAttribute(copies, itemSize, normalized));
  }
  const places = new Float32Array(9 * count);
  for (let i = 0; i < count; i++) {
    const [x, y] = [(i % WIDTH) + 0.5, Math.floor(i / WIDTH) + 0.5];
    places.set([x - 0.4, y - 0.4, 0, x + 0.4, y - 0.4, 0, x, y + 0.4, 0], 9 * i);
  }
  geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
  const copy = new THREE.Mesh(geometry, mesh.material);
  copy.frustumCulled = false;
  copy.onBeforeRender = mesh.onBeforeRender;
  return copy;
}

function shaded(mesh) {
  const count = mesh.geometry.attributes.position.count;
  const height = Math.ceil(count / WIDTH);
  const target = new THREE.WebGLRenderTarget(WIDTH, height, { type: THREE.FloatType, depthBuffer: false });
  renderer.setRenderTarget(target);
  renderer.render(dots(mesh), new THREE.OrthographicCamera(0, WIDTH, height, 0, -1, 1));
  const values = new Float32Array(4 * WIDTH * height);
  renderer.readRenderTargetPixels(target, 0, 0, WIDTH, height, values);
  renderer.setRenderTarget(null);
  return Array.from({ length: count }, (_, i) => [...values.slice(4 * i, 4 * i + 3)]);
}

/** Radiance of each vertex: `turn` (x, y, z, w) of the scene after loading, `albedo`, `edit` [from, to] in the shader. */
window.shadeAsset = async ({ asset, light, turn = [0, 0, 0, 1], albedo = [1, 1, 1], srgb = false, edit = ["", ""] }) => {
  const { scene, meshes } = await meshesOf(asset);
  const vertex = (await text("/engines/prt.vert.glsl")).replace(...edit);
  const fragment = await text("/engines/prt.frag.glsl");
  for (const mesh of meshes) lightMesh(mesh, light, { vertex, fragment, albedo, srgb });
  scene.quaternion.set(...turn);
  scene.updateMatrixWorld(true);
  return meshes.flatMap(shaded);
};

window.probeLight = (json) => lightOfProbe(new THREE.ObjectLoader().parse(json));
window.turned = (light, rows) => turnLight(light, new THREE.Matrix3(...rows.flat()));
window.harmonicsAt = (directions) => directions.map((d) => harmonics(new THREE.Vector3(...d)));

/** A picture of the asset as a page would show it. */
window.draw = async ({ asset, light, turn = [0, 0, 0, 1] }) => {
  const { scene, meshes } = await meshesOf(asset);
  const shaders = { vertex: await text("/engines/prt.vert.glsl"), fragment: await text("/engines/prt.frag.glsl") };
  for (const mesh of meshes) lightMesh(mesh, light, shaders);
  scene.quaternion.set(...turn);
  renderer.setSize(256, 256);
  document.body.append(renderer.domElement);
  const camera = new THREE.OrthographicCamera(-1.3, 1.3, 1.3, -1.3, 0.1, 10);
  camera.position.z = 4;
  const all = new THREE.Scene();
  renderer.render(all.add(scene), camera);
  return renderer.domElement.toDataURL();
};

document.body.dataset.ready = "";
