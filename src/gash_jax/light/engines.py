"""The records of `conventions`: what each program means by the numbers of a light, with the source of each statement.

Facts were read in the sources that they name; the formulas are written again in the tests, from those sources.
"""

import math

from gash_jax.light.conventions import Convention, Fact

_SLOAN = "Sloan, Efficient Spherical Harmonic Evaluation, JCGT 2(2), 2013"
_PIFU = "PIFu, apps/prt_util.py"

CONVENTIONS: dict[str, Convention] = {
    record.name: record
    for record in (
        Convention(
            *("three", "three.js LightProbe", ("x", "y", "z"), (3, 3), False),
            pi="its material",
            turn=-90,
            facts=(
                Fact("basis without sign, radiance coefficients", "three.js, src/math/SphericalHarmonics3.js, getAt"),
                Fact("the shader forms irradiance, A_l L; the material divides by π", "lights_pars_begin.glsl.js"),
                Fact("`equirectUv`: u = atan(z, x) / 2π + 1/2", "three.js, ShaderChunk/common.glsl.js"),
                Fact("`fromArray` takes 27 numbers, r g b of each coefficient", "SphericalHarmonics3.js, fromArray"),
            ),
        ),
        Convention(
            *("unity", "Unity SphericalHarmonicsL2", ("x", "y", "-z"), (3, 3), False),
            pi="done in the numbers",
            polynomial=True,
            turn=-90,
            facts=(
                Fact(
                    "left-handed, +y up, +z forward: z is mirrored",
                    "UnityGLTF in its first form, CoordinateSpaceConversionScale (1, 1, -1)",
                ),
                Fact("A_l/π K_k L_k: irradiance over π as a polynomial", "HDRP, SphericalHarmonics.cs"),
                Fact("seven float4: (3, 1, 2, 0 - 6), (4, 5, 3·6, 7) of each colour, 8", "PackCoefficients, there"),
                Fact("`ShadeSH9` adds the terms and is multiplied by the albedo alone", "UnityCG.cginc"),
                Fact("Skybox/Panoramic: u = 1/2 - atan2(z, x) / 2π", "Skybox-Panoramic.shader, ToRadialCoords"),
            ),
        ),
        Convention(
            *("unity-gltf", "Unity, meshes imported from glTF", ("-x", "y", "z"), (3, 3), False),
            pi="done in the numbers",
            polynomial=True,
            turn=90,
            facts=(
                Fact(
                    "the importer mirrors x; all else is as for `unity`",
                    "UnityGLTF, SchemaExtensions.cs, CoordinateSpaceConversionScale (-1, 1, 1)",
                ),
                Fact("a half turn about +y lies between this and `unity`", "follows from both"),
            ),
        ),
        Convention(
            *("filament", "Filament IndirectLight", ("x", "y", "z"), (1, 3), False),
            pi="done in the numbers",
            polynomial=True,
            turn=180,
            facts=(
                Fact("A_l/π K_k L_k: irradiance over π as a polynomial", "libs/ibl/src/CubemapSH.cpp"),
                Fact(
                    "added up by `Irradiance_SphericalHarmonics`, times the diffuse colour", "surface_light_indirect.fs"
                ),
                Fact("cmgen: u = atan2(x, z) / 2π + 1/2, then mirrored in x", "libs/ibl/src/CubemapUtils.cpp"),
                Fact("`sh.txt`: a line (r, g, b) for each coefficient", "libs/filamentapp/src/IBL.cpp"),
            ),
        ),
        Convention(
            *("d3dx", "D3DX and DirectXMath", ("x", "y", "z"), (2, 6), True),
            pi="you",
            facts=(
                Fact("basis (-1)^m Y: l = 1 is (-y, z, -x)", "DirectXMath, SHMath/DirectXSH.cpp"),
                Fact("2 to 6 bands; axes are the caller's, ours are kept", "DirectXMath, SHMath/DirectXSH.h"),
            ),
        ),
        Convention(
            *("unreal", "Unreal FSHVectorRGB", ("x", "z", "y"), (2, 3), True),
            pi="its packing for the shader",
            turn=0,
            facts=(
                Fact("basis (-1)^m Y, radiance coefficients", "Unreal, SHMath.h, TSHVector<3>::SHBasisFunction"),
                Fact("left-handed, +z up: glTF's y and z change places", "GLTFExporter, GLTFConverterUtility.h"),
                Fact("A_l and 1/π come in when packed for the shader", "SceneRendering.cpp, SetupSkyIrradiance..."),
                Fact("u = atan2(x, -y) / 2π + 1/2 in its axes", "TextureCompressorModule.cpp, LookupLongLat"),
            ),
        ),
        Convention(
            *("blender", "Blender EEVEE", ("x", "-z", "y"), (1, 3), True),
            pi="you",
            turn=-90,
            facts=(
                Fact("basis (-1)^m Y, radiance coefficients", "Blender, eevee_spherical_harmonics_lib.glsl"),
                Fact("+z up: glTF's (x, y, z) is (x, -z, y)", "glTF-Blender-IO, convert_swizzle_location"),
                Fact("u = 1/2 - atan2(y, x) / 2π in its axes", "Cycles, kernel/camera/projection.h"),
            ),
        ),
        Convention(
            *("splats", "3D Gaussian splats", ("x", "y", "z"), (1, 4), True),
            pi="nobody: colours, not light",
            offset=0.5,
            facts=(
                Fact("basis (-1)^m Y, 1/2 added to every colour", "gaussian-splatting, utils/sh_utils.py, eval_sh"),
                Fact("the direction goes from the camera to the splat", "gaussian_renderer/__init__.py, dir_pp"),
                Fact("axes are the scene's, ours are kept", "follows from both"),
            ),
        ),
        Convention(
            *("e3nn", "e3nn, normalization='integral'", ("z", "x", "y"), (1, 10), False),
            pi="you",
            facts=(
                Fact("polar axis y: l = 1 is (x, y, z), no sign, orthonormal", "e3nn, spherical_harmonics, docstring"),
            ),
        ),
        Convention(
            *("mitsuba", "Mitsuba 3, drjit.sh_eval", ("x", "y", "z"), (1, 10), True),
            pi="you",
            turn=180,
            facts=(
                Fact("basis (-1)^m Y", f"Dr.Jit, include/drjit/sh.h, after {_SLOAN}"),
                Fact("u = atan2(x, -z) / 2π, which begins at -z", "Mitsuba 3, src/emitters/envmap.cpp, eval"),
            ),
        ),
        Convention(
            *("pifu", "PIFu, ICON, PaMIR, ECON", ("x", "y", "z"), (3, 3), False),
            pi="the light, as we write it",
            scale=1.0 / math.pi,
            facts=(
                Fact("transfer is the integral of V cos Y without 1/π", f"{_PIFU}, computePRT"),
                Fact("its Legendre functions have the sign (-1)^m", f"{_PIFU}, AssociatedLegendre"),
                Fact("its directions are turned by π about z, which cancels it", f"{_PIFU}, sampleSphericalDirections"),
                Fact("shading is the bare sum of both: the light must bring 1/π", "PIFu, lib/renderer/gl/data/prt.fs"),
                Fact("rows of `bounce0.txt` by corners in `face.npy`", "PIFu, lib/renderer/gl/prt_render.py, set_mesh"),
            ),
        ),
    )
}


def convention(name: str) -> Convention:
    """The record of a name. Raises ValueError with the names that there are."""
    if name not in CONVENTIONS:
        raise ValueError(f"unknown convention {name!r}: choose one of {', '.join(CONVENTIONS)}")
    return CONVENTIONS[name]
