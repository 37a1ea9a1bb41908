// Body of a Custom node of an Unreal material, output type CMOT Float 3: linear radiance of a white surface, to be
// multiplied by the albedo and given to Emissive Color of an unlit material. docs/engines.md says where the numbers come
// from: transfer and light of gash convert, both --to unreal.
//
// Inputs: T01, T23, T45, T67, T8, the five TexCoord nodes with the sets that gash convert named, in order; and L0 to L8,
// nine vector parameters with the colours of the light, one for each coefficient.

float3 sum = T01.x * L0.rgb + T01.y * L1.rgb;
sum += T23.x * L2.rgb + T23.y * L3.rgb;
sum += T45.x * L4.rgb + T45.y * L5.rgb;
sum += T67.x * L6.rgb + T67.y * L7.rgb;
return sum + T8.x * L8.rgb;
