// As much of Unity as GashTransfer.cs touches, and a program that runs the component once outside of it:
//
//   engines.exe FILE.glb LIGHT.json|- PROBE(27 numbers, commas) REST(x,y,z,w) ROOT(x,y,z,w) NOW(x,y,z,w)
//
// REST is how the mesh stands in what was imported, ROOT how that stands in the scene at first, NOW how the mesh stands
// in the scene when it is drawn. Prints what the shader is sent, as JSON.

using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Reflection;
using UnityEngine;
using UnityEngine.Rendering;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public float this[int i] { get { return i == 0 ? x : i == 1 ? y : z; } }
        public static Vector3 right { get { return new Vector3(1, 0, 0); } }
        public static Vector3 up { get { return new Vector3(0, 1, 0); } }
        public static Vector3 forward { get { return new Vector3(0, 0, 1); } }
    }

    public struct Vector4
    {
        public float x, y, z, w;
        public Vector4(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
    }

    public struct Quaternion
    {
        public float x, y, z, w;
        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public static Quaternion Inverse(Quaternion q) { return new Quaternion(-q.x, -q.y, -q.z, q.w); }
        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(
                a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
                a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }
        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            Quaternion turned = q * new Quaternion(v.x, v.y, v.z, 0) * Inverse(q);
            return new Vector3(turned.x, turned.y, turned.z);
        }
    }

    public class Transform { public Quaternion rotation; public Transform root; }
    public class TextAsset { public byte[] bytes; public string text; }
    public class MeshRenderer { public void SetPropertyBlock(MaterialPropertyBlock b) { MonoBehaviour.Sent = b; } }

    public class MonoBehaviour
    {
        public static MaterialPropertyBlock Sent;
        public Transform transform = new Transform();
        public T GetComponent<T>() where T : new() { return new T(); }
    }

    public class MaterialPropertyBlock
    {
        public readonly Dictionary<string, float[]> Values = new Dictionary<string, float[]>();
        public void SetVectorArray(string name, Vector4[] values)
        {
            Values[name] = values.SelectMany(v => new[] { v.x, v.y, v.z, v.w }).ToArray();
        }
        public void SetInt(string name, int value) { Values[name] = new float[] { value }; }
    }

    public static class RenderSettings { public static SphericalHarmonicsL2 ambientProbe; }
    public class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
    public class RequireComponent : Attribute { public RequireComponent(Type type) { } }
}

namespace UnityEngine.Rendering
{
    public struct SphericalHarmonicsL2
    {
        public float[] Numbers;
        public float this[int rgb, int coefficient] { get { return Numbers[9 * rgb + coefficient]; } }
    }
}

static class Program
{
    static float[] Numbers(string text)
    {
        return text.Split(',').Select(word => float.Parse(word, CultureInfo.InvariantCulture)).ToArray();
    }

    static Quaternion Turn(string text)
    {
        float[] n = Numbers(text);
        return new Quaternion(n[0], n[1], n[2], n[3]);
    }

    static void Call(object component, string name)
    {
        component.GetType().GetMethod(name, BindingFlags.NonPublic | BindingFlags.Instance).Invoke(component, null);
    }

    static int Main(string[] given)
    {
        RenderSettings.ambientProbe = new SphericalHarmonicsL2 { Numbers = Numbers(given[2]) };
        var component = new GashTransfer { file = new TextAsset { bytes = File.ReadAllBytes(given[0]) } };
        if (given[1] != "-")
            component.lightFile = new TextAsset { text = File.ReadAllText(given[1]) };
        component.transform.root = new Transform { rotation = Turn(given[4]) };
        component.transform.rotation = Turn(given[4]) * Turn(given[3]);
        try
        {
            Call(component, "Awake");
            component.transform.rotation = Turn(given[5]);
            Call(component, "LateUpdate");
        }
        catch (TargetInvocationException error)
        {
            Console.Error.WriteLine(error.InnerException.Message);
            return 2;
        }
        var parts = MonoBehaviour.Sent.Values.Select(pair => "\"" + pair.Key + "\": [" + string.Join(", ",
            pair.Value.Select(value => value.ToString("R", CultureInfo.InvariantCulture))) + "]");
        Console.WriteLine("{" + string.Join(", ", parts) + "}");
        return 0;
    }
}
