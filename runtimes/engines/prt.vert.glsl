// Matte precomputed radiance transfer, shaded at the vertices. GLSL ES 3.00 (WebGL 2, three.js) or GLSL 3.30 and later;
// put the #version before it. docs/engines.md says where the numbers come from.
//
//   radiance of a colour = sum over k of t_k L_k      t: transfer of the vertex, L: light in the frame of the object
//   t_k = stored_k * scale_k + offset_k               four k to a vector, zeros after the last
//
// Define GASH_VECTORS as 3 for 9 coefficients or 4 for 16, and GASH_COLOURED where red, green and blue have transfer of
// their own (light that bounced off coloured surfaces).

precision highp float;

#ifndef GASH_VECTORS
#define GASH_VECTORS 3
#endif
#ifdef GASH_COLOURED
#define GASH_CHANNELS 3
#else
#define GASH_CHANNELS 1
#endif

uniform mat4 modelViewMatrix, projectionMatrix;
uniform vec4 gashLight[3 * GASH_VECTORS]; // red, then green, then blue
uniform vec4 gashScale[GASH_CHANNELS * GASH_VECTORS]; // of grey, or of red, then green, then blue
uniform vec4 gashOffset[GASH_CHANNELS * GASH_VECTORS];

in vec3 position;
#ifdef GASH_COLOURED
in vec4 _shr0, _shr1, _shr2, _shg0, _shg1, _shg2, _shb0, _shb1, _shb2;
#if GASH_VECTORS == 4
in vec4 _shr3, _shg3, _shb3;
#endif
#else
in vec4 _sh0, _sh1, _sh2;
#if GASH_VECTORS == 4
in vec4 _sh3;
#endif
#endif

out vec3 gashRadiance; // linear, of a white surface

// what leaves in a colour (0 red, 1 green, 2 blue), with the transfer of a channel
float gashShade(vec4 stored[GASH_VECTORS], int channel, int colour) {
  float sum = 0.0;
  for (int i = 0; i < GASH_VECTORS; i++) {
    int place = channel * GASH_VECTORS + i;
    sum += dot(stored[i] * gashScale[place] + gashOffset[place], gashLight[colour * GASH_VECTORS + i]);
  }
  return sum;
}

#if GASH_VECTORS == 4
#define GASH_STORED(a, b, c, d) vec4[4](a, b, c, d)
#else
#define GASH_STORED(a, b, c, d) vec4[3](a, b, c)
#endif

void main() {
#ifdef GASH_COLOURED
  gashRadiance.r = gashShade(GASH_STORED(_shr0, _shr1, _shr2, _shr3), 0, 0);
  gashRadiance.g = gashShade(GASH_STORED(_shg0, _shg1, _shg2, _shg3), 1, 1);
  gashRadiance.b = gashShade(GASH_STORED(_shb0, _shb1, _shb2, _shb3), 2, 2);
#else
  vec4 stored[GASH_VECTORS] = GASH_STORED(_sh0, _sh1, _sh2, _sh3);
  gashRadiance = vec3(gashShade(stored, 0, 0), gashShade(stored, 0, 1), gashShade(stored, 0, 2));
#endif
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}
