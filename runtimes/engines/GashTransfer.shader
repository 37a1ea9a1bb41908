// Matte precomputed radiance transfer in Unity's built-in render pipeline; lit by GashTransfer.cs. The transfer comes as
// pairs in texture coordinates, from gash convert T.npz -o asset.glb --to unity-gltf --attributes uv --bands 3.
Shader "Gash/Transfer"
{
    Properties
    {
        _Color ("Albedo", Color) = (1, 1, 1, 1)
    }
    SubShader
    {
        Tags { "RenderType" = "Opaque" }
        Pass
        {
            HLSLPROGRAM
            #pragma vertex vs
            #pragma fragment ps
            #pragma target 3.0
            #include "UnityCG.cginc"
            #define GASH_FUNCTION_ONLY
            #include "prt.hlsl"

            float4 _Color;
            int gashFirstSet; // of texture coordinates: the file's own come before

            struct Vertex
            {
                float4 position : POSITION;
                float2 set0 : TEXCOORD0;
                float2 set1 : TEXCOORD1;
                float2 set2 : TEXCOORD2;
                float2 set3 : TEXCOORD3;
                float2 set4 : TEXCOORD4;
                float2 set5 : TEXCOORD5;
                float2 set6 : TEXCOORD6;
                float2 set7 : TEXCOORD7;
            };

            struct Pixel
            {
                float4 place : SV_POSITION;
                float3 radiance : COLOR0;
            };

            Pixel vs(Vertex v)
            {
                float2 sets[8] = { v.set0, v.set1, v.set2, v.set3, v.set4, v.set5, v.set6, v.set7 };
                float4 stored[3];
                for (int i = 0; i < 3; i++)
                {
                    float2 first = sets[gashFirstSet + 2 * i];
                    float2 second = i < 2 ? sets[gashFirstSet + 2 * i + 1] : float2(0, 1);
                    // importers count v from below: they store 1 - v
                    stored[i] = float4(first.x, 1 - first.y, second.x, 1 - second.y);
                }
                Pixel pixel;
                pixel.radiance = GashRadiance(stored);
                pixel.place = UnityObjectToClipPos(v.position);
                return pixel;
            }

            float4 ps(Pixel pixel) : SV_TARGET
            {
                return float4(_Color.rgb * pixel.radiance, 1);
            }
            ENDHLSL
        }
    }
}
