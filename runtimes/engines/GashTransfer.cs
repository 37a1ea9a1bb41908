// Lights a mesh by its precomputed transfer in Unity: sends GashTransfer.shader the light as the object sees it, and the
// scale and offset of what is stored. Put it on the object with the MeshRenderer.
//
//   gash convert T.npz -o lit.glb --mesh asset.glb --to unity-gltf --attributes uv --bands 3
//
// Unity's SphericalHarmonicsL2 hold irradiance over pi as a polynomial,
//   c0 + c1 y + c2 z + c3 x + c4 xy + c5 yz + c6 (3zz - 1) + c7 xz + c8 (xx - yy),
// and the transfer in the file is divided by what they were multiplied with, so the sum over k of both is the radiance
// of a white surface, be they of the scene (its ambient probe) or of gash convert light.npz --to unity-gltf.

using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;
using System.Text.RegularExpressions;
using UnityEngine;
using UnityEngine.Rendering;

[RequireComponent(typeof(MeshRenderer))]
public sealed class GashTransfer : MonoBehaviour
{
    [Tooltip("The same .glb again, named lit.glb.bytes: importers leave scale and offset out.")]
    public TextAsset file;

    [Tooltip("The .json of gash convert --to unity-gltf; without it the ambient probe of the scene.")]
    public TextAsset lightFile;

    [Tooltip("The root of what was imported, where it is not the root of this hierarchy: it stands as it was baked.")]
    public Transform imported;

    GashFile stored;
    Quaternion back;
    MaterialPropertyBlock block;

    void Awake()
    {
        stored = GashFile.Read(file.bytes);
        block = new MaterialPropertyBlock();
        Transform root = imported != null ? imported : transform.root;
        back = Quaternion.Inverse(transform.rotation) * root.rotation;
    }

    void LateUpdate()
    {
        float[] light = lightFile != null ? GashLight.Read(lightFile.text) : OfProbe(RenderSettings.ambientProbe);
        block.SetVectorArray("gashLight", InFours(GashLight.Packed(GashLight.Turned(light, Rotation()))));
        block.SetVectorArray("gashScale", InFours(stored.Scale));
        block.SetVectorArray("gashOffset", InFours(stored.Offset));
        block.SetInt("gashFirstSet", stored.FirstSet);
        GetComponent<MeshRenderer>().SetPropertyBlock(block);
    }

    float[,] Rotation()
    {
        Quaternion turned = transform.rotation * back; // since it was baked
        Vector3[] columns = { turned * Vector3.right, turned * Vector3.up, turned * Vector3.forward };
        var matrix = new float[3, 3];
        for (int row = 0; row < 3; row++)
            for (int column = 0; column < 3; column++)
                matrix[row, column] = columns[column][row];
        return matrix;
    }

    static float[] OfProbe(SphericalHarmonicsL2 probe)
    {
        var light = new float[27];
        for (int i = 0; i < 27; i++)
            light[i] = probe[i / 9, i % 9];
        return light;
    }

    static Vector4[] InFours(float[] numbers)
    {
        var vectors = new Vector4[numbers.Length / 4];
        for (int i = 0; i < vectors.Length; i++)
            vectors[i] = new Vector4(numbers[4 * i], numbers[4 * i + 1], numbers[4 * i + 2], numbers[4 * i + 3]);
        return vectors;
    }
}

// What gash convert wrote into the extras of the mesh; twelve numbers each, for three vectors.
public sealed class GashFile
{
    public float[] Scale, Offset;
    public int FirstSet;

    public static GashFile Read(byte[] glb)
    {
        if (glb.Length < 20 || Encoding.ASCII.GetString(glb, 0, 4) != "glTF")
            throw new FormatException("no .glb file: give the one that gash convert wrote");
        string json = Encoding.UTF8.GetString(glb, 20, BitConverter.ToInt32(glb, 12));
        Match found = Regex.Match(json, "\"gash\"\\s*:\\s*\\{[^{}]*\\}");
        if (!found.Success)
            throw new FormatException("the .glb has no transfer: write it by gash convert T.npz -o asset.glb");
        string extras = found.Value;
        Match set = Regex.Match(extras, "\"TEXCOORD_(\\d)\"");
        if (!extras.Contains("\"unity-gltf\"") || !set.Success || !Regex.IsMatch(extras, "\"coefficients\"\\s*:\\s*9\\b"))
            throw new FormatException("convert with --to unity-gltf --attributes uv --bands 3");
        return new GashFile
        {
            Scale = Padded(GashNumbers.After(extras, "scale")),
            Offset = Padded(GashNumbers.After(extras, "offset")),
            FirstSet = int.Parse(set.Groups[1].Value, CultureInfo.InvariantCulture),
        };
    }

    static float[] Padded(float[] numbers)
    {
        Array.Resize(ref numbers, 12);
        return numbers;
    }
}

// Light as 27 numbers, nine of red, of green, of blue, in the convention of SphericalHarmonicsL2.
public static class GashLight
{
    public static float[] Read(string json)
    {
        return GashNumbers.After(json, "SphericalHarmonicsL2");
    }

    // As an object sees it that the rotation R took from rest to where it stands. With the light of a colour written
    // c0 + b.n + n.A n (A symmetric, its trace 0), n = R m gives b' = R^T b and A' = R^T A R.
    public static float[] Turned(float[] light, float[,] r)
    {
        var turned = new float[27];
        for (int colour = 0; colour < 27; colour += 9)
        {
            float[] c = new float[9], b = new float[3];
            Array.Copy(light, colour, c, 0, 9);
            float[,] a = {
                { c[8] - c[6], c[4] / 2, c[7] / 2 },
                { c[4] / 2, -c[8] - c[6], c[5] / 2 },
                { c[7] / 2, c[5] / 2, 2 * c[6] },
            };
            float[] straight = { c[3], c[1], c[2] };
            var t = new float[3, 3];
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 3; k++)
                {
                    b[i] += r[k, i] * straight[k];
                    for (int j = 0; j < 3; j++)
                        for (int l = 0; l < 3; l++)
                            t[i, j] += r[k, i] * a[k, l] * r[l, j];
                }
            float[] result = { c[0], b[1], b[2], b[0], 2 * t[0, 1], 2 * t[1, 2], t[2, 2] / 2, 2 * t[0, 2],
                               (t[0, 0] - t[1, 1]) / 2 };
            Array.Copy(result, 0, turned, colour, 9);
        }
        return turned;
    }

    // Twelve numbers of each colour, zeros after the ninth: three vectors of gashLight.
    public static float[] Packed(float[] light)
    {
        var packed = new float[36];
        for (int colour = 0; colour < 3; colour++)
            Array.Copy(light, 9 * colour, packed, 12 * colour, 9);
        return packed;
    }
}

static class GashNumbers
{
    // The numbers in the brackets after a name, whatever brackets are in between.
    public static float[] After(string json, string name)
    {
        Match found = Regex.Match(json, "\"" + name + "\"\\s*:\\s*(\\[[-+.\\deE,\\s\\[\\]]*\\])");
        if (!found.Success)
            throw new FormatException("no numbers named " + name + ": give a file that gash convert wrote");
        var numbers = new List<float>();
        foreach (Match number in Regex.Matches(found.Groups[1].Value, "[-+.\\deE]+"))
            numbers.Add(float.Parse(number.Value, NumberStyles.Float, CultureInfo.InvariantCulture));
        return numbers.ToArray();
    }
}
