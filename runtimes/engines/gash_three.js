/**
 * Meshes of `gash convert T.npz -o asset.glb` in three.js: a matte material, lit by spherical harmonics.
 *
 *   const light = lightOfProbe(new THREE.ObjectLoader().parse(probe)); // of gash convert light.npz --to three
 *   scene.add((await new GLTFLoader().loadAsync("asset.glb")).scene);
 *   scene.traverse((object) => object.userData.gash && lightMesh(object, light, { vertex, fragment }));
 *
 * `vertex` and `fragment` are the texts of prt.vert.glsl and prt.frag.glsl. A light is a list of colours [r, g, b], one
 * for each coefficient, as many as the transfer has or more: radiance in the world, in the order and scale of
 * CONVENTIONS.md, which are those of a LightProbe. It may change at any time: `mesh.userData.gashLight = other`.
 */

import { GLSL3, Matrix3, RawShaderMaterial, Vector3, Vector4 } from "three";

/** The light of a THREE.LightProbe. */
export function lightOfProbe(probe) {
  return probe.sh.coefficients.map((c) => c.clone().multiplyScalar(probe.intensity).toArray());
}

/**
 * Gives a mesh a material that shades it by its transfer. Call it before anything is moved: how the mesh stands then is
 * how it was baked, and before each picture the light is turned by what was turned since.
 */
export function lightMesh(mesh, light, { vertex, fragment, albedo = [1, 1, 1], srgb = true }) {
  const { coefficients, channels, scale, offset, convention } = mesh.userData.gash;
  if (convention !== "gash") throw new Error(`transfer in the convention ${convention}: convert it without --to`);
  if (!("_sh0" in mesh.geometry.attributes || "_shr0" in mesh.geometry.attributes))
    throw new Error("transfer in texture coordinates: convert it with --attributes sh");
  if (coefficients !== 9 && coefficients !== 16)
    throw new Error(`${coefficients} coefficients a vertex: bake with --bands 3 or 4`);
  if (light.length < coefficients) throw new Error(`the light has ${light.length} coefficients of ${coefficients}`);
  const vectors = Math.ceil(coefficients / 4);
  const defines = { GASH_VECTORS: vectors };
  if (channels === 3) defines.GASH_COLOURED = 1;
  if (srgb) defines.GASH_SRGB = 1;
  const lit = new Array(12 * vectors).fill(0);
  const material = new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: vertex,
    fragmentShader: fragment,
    defines,
    uniforms: {
      gashLight: { value: inFours(lit) },
      gashScale: { value: inFours(scale) },
      gashOffset: { value: inFours(offset) },
      gashAlbedo: { value: new Vector3(...albedo) },
    },
  });
  mesh.userData.gashLight = light;
  mesh.updateWorldMatrix(true, false);
  const back = rotationOf(mesh.matrixWorld).transpose();
  mesh.onBeforeRender = () => {
    const rotation = rotationOf(mesh.matrixWorld).multiply(back);
    const turned = turnLight(mesh.userData.gashLight.slice(0, coefficients), rotation);
    turned.forEach((colour, k) => colour.forEach((value, c) => (lit[4 * vectors * c + k] = value)));
    material.uniforms.gashLight.value = inFours(lit);
    material.uniformsNeedUpdate = true;
  };
  mesh.material = material;
}

function inFours(numbers) {
  return Array.from({ length: numbers.length / 4 }, (_, i) => new Vector4(...numbers.slice(4 * i, 4 * i + 4)));
}

/** The rotation in a matrix of rotation, scale and place, row by row: scale is divided out of its columns. */
export function rotationOf(matrix) {
  const [x, y, z] = [new Vector3(), new Vector3(), new Vector3()];
  matrix.extractBasis(x, y, z);
  [x, y, z].forEach((axis) => axis.normalize());
  return new Matrix3(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z);
}

// the 26 directions {-1, 0, 1}^3 and their weights by the number of axes: Lebedev's rule, exact for polynomials of
// degree 7, and a product of two harmonics of four bands has degree 6
const WEIGHTS = [0, 1 / 21, 4 / 105, 9 / 280];
const DIRECTIONS = [-1, 0, 1]
  .flatMap((x) => [-1, 0, 1].flatMap((y) => [-1, 0, 1].map((z) => new Vector3(x, y, z))))
  .filter((direction) => direction.lengthSq() > 0)
  .map((direction) => ({ weight: WEIGHTS[direction.lengthSq()], direction: direction.normalize() }));

/**
 * The light as an object sees it that a rotation (Matrix3) took from rest to where it stands: projected anew from its
 * values in the directions that the object's own directions have become. Up to four bands.
 */
export function turnLight(light, rotation) {
  const turned = light.map(() => [0, 0, 0]);
  for (const { weight, direction } of DIRECTIONS) {
    const world = harmonics(direction.clone().applyMatrix3(rotation));
    const arriving = [0, 1, 2].map((c) => light.reduce((sum, colour, k) => sum + colour[c] * world[k], 0));
    const own = harmonics(direction);
    turned.forEach((colour, k) => arriving.forEach((value, c) => (colour[c] += 4 * Math.PI * weight * own[k] * value)));
  }
  return turned;
}

/** Real spherical harmonics Y_k of a unit vector, four bands, k = l*l + l + m, no Condon-Shortley sign. */
export function harmonics({ x, y, z }) {
  const [one, two, three] = [Math.sqrt(3 / (4 * Math.PI)), Math.sqrt(15 / (4 * Math.PI)), Math.sqrt(7 / (16 * Math.PI))];
  const [four, five] = [Math.sqrt(21 / (32 * Math.PI)), Math.sqrt(35 / (32 * Math.PI))];
  const [six, zonal] = [Math.sqrt(105 / (4 * Math.PI)), Math.sqrt(5 / (16 * Math.PI))];
  return [
    Math.sqrt(1 / (4 * Math.PI)),
    ...[one * y, one * z, one * x],
    ...[two * x * y, two * y * z, zonal * (3 * z * z - 1), two * x * z, (two / 2) * (x * x - y * y)],
    ...[five * y * (3 * x * x - y * y), six * x * y * z, four * y * (5 * z * z - 1)],
    ...[three * z * (5 * z * z - 3), four * x * (5 * z * z - 1), (six / 2) * z * (x * x - y * y)],
    five * x * (x * x - 3 * y * y),
  ];
}
