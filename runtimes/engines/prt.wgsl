// Matte precomputed radiance transfer, shaded at the vertices, for WebGPU. docs/engines.md says where the numbers come
// from.
//
//   radiance of a colour = sum over k of t_k L_k      t: transfer of the vertex, L: light in the frame of the object
//   t_k = stored_k * scale_k + offset_k               four k to a vector, zeros after the last
//
// A pipeline takes one of the vertex stages grey9, grey16, coloured9, coloured16 (9 or 16 coefficients; coloured where
// red, green and blue have transfer of their own), and one of the fragment stages linear, srgb.

struct Gash {
  modelViewProjection: mat4x4f,
  albedo: vec4f,
  light: array<vec4f, 12>, // red, then green, then blue: 3 vectors each of 9 coefficients, 4 each of 16
  scale: array<vec4f, 12>, // of grey, or of red, then green, then blue
  offset: array<vec4f, 12>,
}

@group(0) @binding(0) var<uniform> gash: Gash;

struct Pixel {
  @builtin(position) place: vec4f,
  @location(0) radiance: vec3f, // linear, of a white surface
}

fn transfer(stored: vec4f, place: u32) -> vec4f {
  return stored * gash.scale[place] + gash.offset[place];
}

// what leaves in three colours by one vector of the transfer, the same for all or one for each
fn lit(red: vec4f, green: vec4f, blue: vec4f, i: u32, vectors: u32) -> vec3f {
  return vec3f(
    dot(red, gash.light[i]),
    dot(green, gash.light[vectors + i]),
    dot(blue, gash.light[2u * vectors + i]),
  );
}

fn shade(stored: array<vec4f, 12>, vectors: u32, coloured: bool) -> vec3f {
  var all = stored;
  let next = select(0u, vectors, coloured);
  var sum = vec3f(0.0);
  for (var i = 0u; i < vectors; i++) {
    let red = transfer(all[i], i);
    let green = transfer(all[next + i], next + i);
    let blue = transfer(all[2u * next + i], 2u * next + i);
    sum += lit(red, green, blue, i, vectors);
  }
  return sum;
}

fn placed(position: vec3f, radiance: vec3f) -> Pixel {
  return Pixel(gash.modelViewProjection * vec4f(position, 1.0), radiance);
}

struct Grey9 {
  @location(0) position: vec3f,
  @location(1) s0: vec4f, @location(2) s1: vec4f, @location(3) s2: vec4f,
}

struct Grey16 {
  @location(0) position: vec3f,
  @location(1) s0: vec4f, @location(2) s1: vec4f, @location(3) s2: vec4f, @location(4) s3: vec4f,
}

struct Coloured9 {
  @location(0) position: vec3f,
  @location(1) r0: vec4f, @location(2) r1: vec4f, @location(3) r2: vec4f,
  @location(4) g0: vec4f, @location(5) g1: vec4f, @location(6) g2: vec4f,
  @location(7) b0: vec4f, @location(8) b1: vec4f, @location(9) b2: vec4f,
}

struct Coloured16 {
  @location(0) position: vec3f,
  @location(1) r0: vec4f, @location(2) r1: vec4f, @location(3) r2: vec4f, @location(4) r3: vec4f,
  @location(5) g0: vec4f, @location(6) g1: vec4f, @location(7) g2: vec4f, @location(8) g3: vec4f,
  @location(9) b0: vec4f, @location(10) b1: vec4f, @location(11) b2: vec4f, @location(12) b3: vec4f,
}

@vertex
fn grey9(v: Grey9) -> Pixel {
  let o = vec4f(0.0);
  return placed(v.position, shade(array<vec4f, 12>(v.s0, v.s1, v.s2, o, o, o, o, o, o, o, o, o), 3u, false));
}

@vertex
fn grey16(v: Grey16) -> Pixel {
  let o = vec4f(0.0);
  return placed(v.position, shade(array<vec4f, 12>(v.s0, v.s1, v.s2, v.s3, o, o, o, o, o, o, o, o), 4u, false));
}

@vertex
fn coloured9(v: Coloured9) -> Pixel {
  let o = vec4f(0.0);
  let stored = array<vec4f, 12>(v.r0, v.r1, v.r2, v.g0, v.g1, v.g2, v.b0, v.b1, v.b2, o, o, o);
  return placed(v.position, shade(stored, 3u, true));
}

@vertex
fn coloured16(v: Coloured16) -> Pixel {
  let stored =
    array<vec4f, 12>(v.r0, v.r1, v.r2, v.r3, v.g0, v.g1, v.g2, v.g3, v.b0, v.b1, v.b2, v.b3);
  return placed(v.position, shade(stored, 4u, true));
}

// for a target that is an sRGB one, or exposed later
@fragment
fn linear(pixel: Pixel) -> @location(0) vec4f {
  return vec4f(gash.albedo.rgb * pixel.radiance, 1.0);
}

@fragment
fn srgb(pixel: Pixel) -> @location(0) vec4f {
  let bounded = clamp(gash.albedo.rgb * pixel.radiance, vec3f(0.0), vec3f(1.0));
  let bright = 1.055 * pow(bounded, vec3f(1.0 / 2.4)) - 0.055;
  return vec4f(select(bright, 12.92 * bounded, bounded < vec3f(0.0031308)), 1.0);
}
