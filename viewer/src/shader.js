/**
 * Shading on the graphics card, in the order of `light.shading` and `light.gloss`: radiance at the vertices, linear in
 * between, exposed and written as sRGB at the end, after the samples of a pixel were averaged. Of transfer in a texture
 * the texels are shaded first and looked up bilinearly at every sample, as `geometry.bilinear` does.
 *
 * A data texture holds numbers one after the other, four in a texel, row by row; `number` finds the i-th. The table holds
 * what they are multiplied by: row 0 the light (k, 3), or the products A_jic of `multiplier` (row j, column i).
 */

const SHADING = /* glsl */ `
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D dataA, dataB, lights, products, scalars;
uniform int kindA, kindB, bands, show, chosen;
uniform bool glossy;
uniform float scale;

float number(sampler2D data, int i) {
  int width = textureSize(data, 0).x;
  return texelFetch(data, ivec2((i >> 2) % width, (i >> 2) / width), 0)[i & 3];
}

vec3 diffuse(sampler2D data, int kind, int place) {
  int count = bands * bands;
  vec3 sum = vec3(0.0);
  for (int k = 0; k < count; k++) {
    vec3 light = texelFetch(lights, ivec2(k, 0), 0).rgb;
    int i = place * count + k;
    if (kind == 0) sum += number(data, i) * light;
    else sum += vec3(number(data, 3 * i), number(data, 3 * i + 1), number(data, 3 * i + 2)) * light;
  }
  return sum;
}

float coefficient(int place) {
  int i = place * bands * bands + chosen;
  if (kindA == 0) return number(dataA, i);
  return (number(dataA, 3 * i) + number(dataA, 3 * i + 1) + number(dataA, 3 * i + 2)) / 3.0;
}

vec3 radiance(sampler2D data, int kind, int place);

vec3 shown(int place) {
  if (show == 0) return scale * radiance(dataA, kindA, place);
  if (show == 1) return scale * vec3(dot(radiance(dataA, kindA, place) - radiance(dataB, kindB, place), vec3(1.0 / 3.0)));
  if (show == 2) return scale * vec3(coefficient(place));
  return scale * vec3(number(scalars, place));
}
`;

export const VERTEX = /* glsl */ `
${SHADING}
in vec3 position;
in vec3 normal;
uniform mat4 clip;
uniform vec3 eye;
uniform float factors[10];
out vec3 value;

void lobe(vec3 d, out float values[100]) {
  float cosine = 1.0, sine = 0.0, sectoral = 0.28209479177387814;
  for (int m = 0; m < bands; m++) {
    float f = float(m);
    if (m > 0) {
      float next = d.x * cosine - d.y * sine;
      sine = d.x * sine + d.y * cosine;
      cosine = next;
      sectoral *= sqrt((2.0 * f + 1.0) / (2.0 * f)) * (m == 1 ? 1.4142135623730951 : 1.0);
    }
    float before = 0.0, here = sectoral;
    for (int l = m; l < bands; l++) {
      if (l > m) {
        float b = float(l);
        float grow = sqrt((4.0 * b * b - 1.0) / (b * b - f * f));
        float fade = grow * sqrt(((b - 1.0) * (b - 1.0) - f * f) / (4.0 * (b - 1.0) * (b - 1.0) - 1.0));
        float next = grow * d.z * here - fade * before;
        before = here;
        here = next;
      }
      values[l * l + l + m] = factors[l] * here * cosine;
      if (m > 0) values[l * l + l - m] = factors[l] * here * sine;
    }
  }
}

vec3 specular(sampler2D data, int kind) {
  float values[100];
  vec3 toward = normalize(eye - position);
  lobe(2.0 * dot(normal, toward) * normal - toward, values);
  int count = bands * bands;
  vec3 sum = vec3(0.0);
  if (kind == 2) {
    int many = (2 * bands - 1) * (2 * bands - 1);
    for (int j = 0; j < many; j++) {
      vec3 product = vec3(0.0);
      for (int i = 0; i < count; i++) product += values[i] * texelFetch(products, ivec2(i, j), 0).rgb;
      sum += number(data, gl_VertexID * many + j) * product;
    }
  } else {
    for (int i = 0; i < count; i++) {
      vec3 arriving = vec3(0.0);
      int row = (gl_VertexID * count + i) * count;
      for (int j = 0; j < count; j++) arriving += number(data, row + j) * texelFetch(lights, ivec2(j, 0), 0).rgb;
      sum += values[i] * arriving;
    }
  }
  return sum;
}

vec3 radiance(sampler2D data, int kind, int place) {
  return glossy ? specular(data, kind) : diffuse(data, kind, place);
}

void main() {
  value = shown(gl_VertexID);
  gl_Position = clip * vec4(position, 1.0);
}
`;

/** What every texel shows, row 0 of the texture in row 0 of the target. */
export const TEXELS = /* glsl */ `
${SHADING}
uniform int side;
out vec4 color;

vec3 radiance(sampler2D data, int kind, int place) {
  return diffuse(data, kind, place);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  color = vec4(shown(at.y * side + at.x), 1.0);
}
`;

export const TEXTURED_VERTEX = /* glsl */ `
precision highp float;
in vec3 position;
in vec2 uv;
uniform mat4 clip;
out vec2 where;
void main() {
  where = uv;
  gl_Position = clip * vec4(position, 1.0);
}
`;

export const TEXTURED = /* glsl */ `
precision highp float;
precision highp sampler2D;
in vec2 where;
uniform sampler2D texels;
out vec4 color;
void main() {
  int last = textureSize(texels, 0).x - 1;
  vec2 place = clamp(where * float(last + 1) - 0.5, 0.0, float(last));
  ivec2 first = ivec2(place);
  ivec2 next = min(first + 1, last);
  vec2 part = place - vec2(first);
  vec3 above = mix(texelFetch(texels, first, 0).rgb, texelFetch(texels, ivec2(next.x, first.y), 0).rgb, part.x);
  vec3 below = mix(texelFetch(texels, ivec2(first.x, next.y), 0).rgb, texelFetch(texels, next, 0).rgb, part.x);
  color = vec4(mix(above, below, part.y), 1.0);
}
`;

export const FRAGMENT = /* glsl */ `
precision highp float;
in vec3 value;
out vec4 color;
void main() {
  color = vec4(value, 1.0);
}
`;

/** Edges of the faces, which darken what they are drawn over. */
export const LINES_VERTEX = /* glsl */ `
precision highp float;
in vec3 position;
uniform mat4 clip;
void main() {
  gl_Position = clip * vec4(position, 1.0);
}
`;

export const LINES = /* glsl */ `
precision highp float;
out vec4 color;
void main() {
  color = vec4(vec3(0.45), 1.0);
}
`;

export const SCREEN = /* glsl */ `
precision highp float;
in vec3 position;
out vec2 place;
void main() {
  place = position.xy;
  gl_Position = vec4(position.xy, 0.0, 1.0);
}
`;

export const FINISH = /* glsl */ `
precision highp float;
precision highp sampler2D;
in vec2 place;
uniform sampler2D samples, surroundings, ramp;
uniform int palette, behind;
uniform float exposure;
uniform mat3 axes, turn;
uniform vec4 frame;
out vec4 color;

const float PI = 3.141592653589793;

vec3 around() {
  vec3 d = turn * (axes * vec3(frame.xy + place * frame.zw, 1.0));
  d = normalize(d);
  vec2 uv = vec2(atan(d.x, -d.z) / (2.0 * PI) + 0.5, acos(clamp(d.y, -1.0, 1.0)) / PI);
  return exposure * textureLod(surroundings, uv, 0.0).rgb;
}

vec3 encoded(vec3 linear) {
  linear = clamp(linear, 0.0, 1.0);
  return mix(1.055 * pow(max(linear, 1e-8), vec3(1.0 / 2.4)) - 0.055, 12.92 * linear, lessThanEqual(linear, vec3(0.0031308)));
}

void main() {
  ivec2 at = 2 * ivec2(gl_FragCoord.xy);
  vec4 pixel = vec4(0.0);
  for (int i = 0; i < 4; i++) pixel += 0.25 * texelFetch(samples, at + ivec2(i & 1, i >> 1), 0);
  if (palette == 0) {
    vec3 ground = behind == 0 ? vec3(mix(0.4, 0.1, 0.5 * place.y + 0.5)) : around();
    color = vec4(encoded(max(pixel.rgb, 0.0) + ground * (1.0 - pixel.a)), 1.0);
  } else {
    float x = clamp(pixel.r / max(pixel.a, 1e-6), palette == 1 ? -1.0 : 0.0, 1.0);
    float steps = float(textureSize(ramp, 0).x);
    float step = (palette == 1 ? 0.5 * x + 0.5 : x) * (steps - 1.0) + 0.5;
    vec3 shade = texture(ramp, vec2(step / steps, 0.5)).rgb;
    color = vec4(mix(vec3(200.0 / 255.0), shade, pixel.a), 1.0);
  }
}
`;
