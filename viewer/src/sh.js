/**
 * Real spherical harmonics as in `gash_jax.algebra.sh`: orthonormal, polar axis z, k = l*l + l + m, no Condon-Shortley
 * sign. Light is a Float64Array of bands² x 3 numbers, one row for each coefficient.
 */

/** Number of bands of so many coefficients, 0 where there is none. */
export function bandsOf(count) {
  const bands = Math.round(Math.sqrt(count));
  return bands * bands === count && bands <= 19 ? bands : 0;
}

export function bandIndex(bands) {
  return Array.from({ length: bands * bands }, (_, k) => Math.floor(Math.sqrt(k)));
}

/** Y_k of a unit vector in `bands` bands, written to `out`: the recurrence in l of sh.py. */
export function basis(x, y, z, bands, out) {
  let cosine = 1;
  let sine = 0;
  let sectoral = Math.sqrt(1 / (4 * Math.PI));
  for (let m = 0; m < bands; m++) {
    if (m > 0) {
      [cosine, sine] = [x * cosine - y * sine, x * sine + y * cosine];
      sectoral *= Math.sqrt((2 * m + 1) / (2 * m)) * (m === 1 ? Math.SQRT2 : 1);
    }
    let before = 0;
    let value = sectoral;
    for (let l = m; l < bands; l++) {
      if (l > m) {
        const grow = Math.sqrt((4 * l * l - 1) / (l * l - m * m));
        const fade = grow * Math.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1));
        [before, value] = [value, grow * z * value - fade * before];
      }
      out[l * l + l + m] = value * cosine;
      if (m > 0) out[l * l + l - m] = value * sine;
    }
  }
  return out;
}

/** Nodes and weights of Gauss and Legendre on [-1, 1]. */
export function gaussLegendre(count) {
  return Array.from({ length: count }, (_, i) => {
    let x = Math.cos((Math.PI * (i + 0.75)) / (count + 0.5));
    let slope = 1;
    for (let step = 0; step < 20; step++) {
      let [before, value] = [1, x];
      for (let l = 2; l <= count; l++) [before, value] = [value, ((2 * l - 1) * x * value - (l - 1) * before) / l];
      slope = (count * (x * value - before)) / (x * x - 1);
      x -= value / slope;
    }
    return [x, 2 / ((1 - x * x) * slope * slope)];
  });
}

/** Directions and weights that integrate polynomials of the degree over the sphere exactly: rows x, y, z, weight. */
export function sphereNodes(degree) {
  const steps = degree + 1;
  return gaussLegendre(Math.ceil(steps / 2)).flatMap(([z, weight]) =>
    Array.from({ length: steps }, (_, j) => {
      const [r, azimuth] = [Math.sqrt(1 - z * z), (2 * Math.PI * j) / steps];
      return [r * Math.cos(azimuth), r * Math.sin(azimuth), z, (weight * 2 * Math.PI) / steps];
    }),
  );
}

/** Radiance of a light in a direction, three numbers. */
export function radianceToward(light, x, y, z) {
  const bands = bandsOf(light.length / 3);
  const values = basis(x, y, z, bands, new Float64Array(bands * bands));
  const sum = [0, 0, 0];
  values.forEach((value, k) => {
    for (let c = 0; c < 3; c++) sum[c] += value * light[3 * k + c];
  });
  return sum;
}

/** The light turned by a rotation matrix R (nine numbers, row by row): what came from w comes from R w. */
export function rotateLight(light, R) {
  const bands = bandsOf(light.length / 3);
  const turned = new Float64Array(light.length);
  const values = new Float64Array(bands * bands);
  for (const [x, y, z, weight] of sphereNodes(2 * (bands - 1))) {
    const from = [0, 1, 2].map((i) => R[i] * x + R[3 + i] * y + R[6 + i] * z);
    const radiance = radianceToward(light, ...from);
    basis(x, y, z, bands, values).forEach((value, k) => {
      for (let c = 0; c < 3; c++) turned[3 * k + c] += weight * value * radiance[c];
    });
  }
  return turned;
}

/**
 * A_jic, the integral of Y_j Y_i L_c, with j in 2B - 1 bands and i in B: visibility v times light has the coefficients
 * sum_j v_j A_jic (`algebra.gaunt.multiplier`). Row j holds bands² x 3 numbers.
 */
export function multiplier(light) {
  const bands = bandsOf(light.length / 3);
  const [few, many] = [bands * bands, (2 * bands - 1) ** 2];
  const product = new Float64Array(many * few * 3);
  const values = new Float64Array(many);
  for (const [x, y, z, weight] of sphereNodes(4 * (bands - 1))) {
    basis(x, y, z, 2 * bands - 1, values);
    const flux = radianceToward(light, x, y, z).map((value) => value * weight);
    let at = 0;
    for (let j = 0; j < many; j++) {
      for (let i = 0; i < few; i++) {
        for (let c = 0; c < 3; c++) product[at++] += values[j] * values[i] * flux[c];
      }
    }
  }
  return product;
}

/**
 * Coefficients of a latlong map { width, height, pixels } as `gash_jax.light.environment.project_map`: rows are brought
 * to 2 bands - 1 azimuths by the Dirichlet kernel, which is exact.
 */
export function projectMap({ width, height, pixels }, bands) {
  const steps = Math.min(2 * bands - 1, width);
  const kernel = new Float64Array(steps * width);
  for (let s = 0; s < steps; s++) {
    for (let j = 0; j < width; j++) {
      const apart = 2 * Math.PI * ((s + 0.5) / steps - (j + 0.5) / width);
      let value = 1;
      for (let m = 1; m < bands; m++) value += 2 * Math.cos(m * apart);
      kernel[s * width + j] = steps === width ? Number(s === j) : value / steps;
    }
  }
  const light = new Float64Array(bands * bands * 3);
  const values = new Float64Array(bands * bands);
  for (let i = 0; i < height; i++) {
    const t = ((i + 0.5) / height) * Math.PI;
    const area = ((2 * Math.PI) / width) * 2 * Math.sin(Math.PI / (2 * height)) * Math.sin(t);
    for (let s = 0; s < steps; s++) {
      const p = ((s + 0.5) / steps - 0.5) * 2 * Math.PI;
      basis(Math.sin(t) * Math.sin(p), Math.cos(t), -Math.sin(t) * Math.cos(p), bands, values);
      for (let c = 0; c < 3; c++) {
        let flux = 0;
        for (let j = 0; j < width; j++) flux += kernel[s * width + j] * pixels[(i * width + j) * 3 + c];
        for (let k = 0; k < values.length; k++) light[3 * k + c] += area * flux * values[k];
      }
    }
  }
  return light;
}
