// Matte precomputed radiance transfer, shaded at the vertices, for Direct3D and Unity. docs/engines.md says where the
// numbers come from.
//
//   radiance of a colour = sum over k of t_k L_k      t: transfer of the vertex, L: light in the frame of the object
//   t_k = stored_k * scale_k + offset_k               four k to a vector, zeros after the last
//
// Define GASH_VECTORS as 3 for 9 coefficients or 4 for 16, GASH_COLOURED where red, green and blue have transfer of
// their own, and GASH_FUNCTION_ONLY to have GashRadiance without the entry points vs_main and ps_main.

#ifndef GASH_VECTORS
#define GASH_VECTORS 3
#endif
#ifdef GASH_COLOURED
#define GASH_CHANNELS 3
#else
#define GASH_CHANNELS 1
#endif

float4 gashLight[3 * GASH_VECTORS]; // red, then green, then blue
float4 gashScale[GASH_CHANNELS * GASH_VECTORS]; // of grey, or of red, then green, then blue
float4 gashOffset[GASH_CHANNELS * GASH_VECTORS];

// linear radiance of a white surface, from what is stored for grey, or for red, then green, then blue
float3 GashRadiance(float4 stored[GASH_CHANNELS * GASH_VECTORS]) {
  float3 sum = float3(0.0, 0.0, 0.0);
  for (int i = 0; i < GASH_VECTORS; i++) {
    float4 transfer[GASH_CHANNELS];
    for (int c = 0; c < GASH_CHANNELS; c++) {
      int place = c * GASH_VECTORS + i;
      transfer[c] = stored[place] * gashScale[place] + gashOffset[place];
    }
    sum.r += dot(transfer[0], gashLight[i]);
    sum.g += dot(transfer[GASH_CHANNELS / 2], gashLight[GASH_VECTORS + i]); // of one channel 0, of three 1
    sum.b += dot(transfer[GASH_CHANNELS - 1], gashLight[2 * GASH_VECTORS + i]);
  }
  return sum;
}

#ifndef GASH_FUNCTION_ONLY
float4x4 modelViewProjection;
float3 gashAlbedo;

struct GashVertex {
  float3 position : POSITION;
  float4 stored[GASH_CHANNELS * GASH_VECTORS] : SH; // SH0, SH1, ...: snorm or float, as the file has them
};

struct GashPixel {
  float4 place : SV_POSITION;
  float3 radiance : COLOR0;
};

GashPixel vs_main(GashVertex vertex) {
  GashPixel pixel;
  pixel.radiance = GashRadiance(vertex.stored);
  pixel.place = mul(modelViewProjection, float4(vertex.position, 1.0));
  return pixel;
}

// linear: the target is an sRGB one, or exposed later
float4 ps_main(GashPixel pixel) : SV_TARGET {
  return float4(gashAlbedo * pixel.radiance, 1.0);
}
#endif
