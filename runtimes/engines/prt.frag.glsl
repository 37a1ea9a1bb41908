// The colour of a pixel from the radiance that prt.vert.glsl found at the vertices. Define GASH_SRGB where the picture
// is what a screen shows; without it the colour stays linear, for a buffer that is exposed later.

precision highp float;

uniform vec3 gashAlbedo;

in vec3 gashRadiance;
out vec4 gashColour;

vec3 gashSrgb(vec3 linear) {
  vec3 bounded = clamp(linear, 0.0, 1.0);
  return mix(12.92 * bounded, 1.055 * pow(bounded, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, bounded));
}

void main() {
  vec3 leaving = gashAlbedo * gashRadiance;
#ifdef GASH_SRGB
  leaving = gashSrgb(leaving);
#endif
  gashColour = vec4(leaving, 1.0);
}
