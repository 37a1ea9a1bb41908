"""The shaders compile: GLSL and HLSL with Khronos' glslang, in every form that they have; broken ones do not."""

import re
from pathlib import Path

import pytest

from tests.helpers.tools import tool

ENGINES = Path(__file__).parents[3] / "runtimes" / "engines"
DEFINES = ["", "GASH_VECTORS 4", "GASH_COLOURED", "GASH_COLOURED\n#define GASH_VECTORS 4"]
FORMS = [f"#define {define}\n" if define else "" for define in DEFINES]
# what GashTransfer.shader takes from Unity
UNITY = "float4x4 unityPlace;\nfloat4 UnityObjectToClipPos(float4 p) { return mul(unityPlace, p); }"
# how Unreal wraps the body of a Custom node
NODE = """float3 CustomExpression0(float2 T01, float2 T23, float2 T45, float2 T67, float2 T8, float4 L0, float4 L1,
  float4 L2, float4 L3, float4 L4, float4 L5, float4 L6, float4 L7, float4 L8) {
%s
}
cbuffer Material { float4 Light[9]; };
float4 main(float2 a : TEXCOORD0, float2 b : TEXCOORD1, float2 c : TEXCOORD2, float2 d : TEXCOORD3,
  float2 e : TEXCOORD4) : SV_TARGET {
  return float4(CustomExpression0(a, b, c, d, e, Light[0], Light[1], Light[2], Light[3], Light[4], Light[5], Light[6],
    Light[7], Light[8]), 1.0);
}
"""


def complaints(source: str, stage: str, folder: Path, entry: str = "") -> str:
    """What glslang says of a shader: HLSL where an entry point is named, else GLSL."""
    path = folder / "shader.txt"
    path.write_text(source)
    hlsl = ["-D", "-V", "-e", entry, "-o", str(folder / "shader.spv")] if entry else []
    result = tool("glslangValidator", "-S", stage, *hlsl, path)
    assert ("ERROR" in result.stdout) == (result.returncode != 0), result.stdout + result.stderr
    return result.stdout if result.returncode else ""


def text(name: str) -> str:
    return (ENGINES / name).read_text()


def unity_program() -> str:
    """The HLSL of GashTransfer.shader, whole."""
    (program,) = re.findall(r"HLSLPROGRAM\n(.*?)ENDHLSL", text("GashTransfer.shader"), re.DOTALL)
    return program.replace('#include "UnityCG.cginc"', UNITY).replace('#include "prt.hlsl"', text("prt.hlsl"))


@pytest.mark.parametrize("form", FORMS, ids=["9", "16", "9 coloured", "16 coloured"])
@pytest.mark.parametrize("version", ["300 es", "330", "410"])
def test_glsl_compiles(version: str, form: str, tmp_path: Path) -> None:
    assert complaints(f"#version {version}\n{form}{text('prt.vert.glsl')}", "vert", tmp_path) == ""
    for screen in ("", "#define GASH_SRGB\n"):
        assert complaints(f"#version {version}\n{screen}{text('prt.frag.glsl')}", "frag", tmp_path) == ""


@pytest.mark.parametrize("form", FORMS, ids=["9", "16", "9 coloured", "16 coloured"])
def test_hlsl_compiles(form: str, tmp_path: Path) -> None:
    assert complaints(form + text("prt.hlsl"), "vert", tmp_path, "vs_main") == ""
    assert complaints(form + text("prt.hlsl"), "frag", tmp_path, "ps_main") == ""


def test_the_shader_for_unity_compiles(tmp_path: Path) -> None:
    assert complaints(unity_program(), "vert", tmp_path, "vs") == ""
    assert complaints(unity_program(), "frag", tmp_path, "ps") == ""


def test_the_node_for_unreal_compiles(tmp_path: Path) -> None:
    assert complaints(NODE % text("prt_unreal.hlsl"), "frag", tmp_path, "main") == ""


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("prt.vert.glsl", "dot(stored[i]", "dot(store[i]"),
        ("prt.vert.glsl", "float sum = 0.0;", "float sum = vec2(0.0);"),
        ("prt.hlsl", "dot(transfer[0]", "dott(transfer[0]"),
        ("prt.hlsl", "return sum;", "return sum"),
    ],
)
def test_broken_shaders_are_noticed(name: str, right: str, wrong: str, tmp_path: Path) -> None:
    assert text(name).count(right) == 1
    broken = text(name).replace(right, wrong)
    glsl = name.endswith(".glsl")
    head, entry = ("#version 300 es\n", "") if glsl else ("", "vs_main")
    assert "ERROR" in complaints(head + broken, "vert", tmp_path, entry)
