"""gash_jax: precomputed radiance transfer you can trust.

Bake per-vertex spherical-harmonic transfer with Embree, predict it with networks, relight it, and know the error.
Names are imported when they are first used, so that a bake does not wait for the neural-network libraries.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gash_jax.algebra.cga import geometric_product
    from gash_jax.algebra.closed_forms import unshadowed_transfer
    from gash_jax.algebra.motors import embed_point, motor, motor_to_rigid, rotor_from_normal, rotor_to_matrix
    from gash_jax.apps.pictures.render import render
    from gash_jax.apps.pictures.show import show
    from gash_jax.apps.viewer.page import Page, view
    from gash_jax.files.atomic import FileError
    from gash_jax.files.caches import keep_compiled_programs
    from gash_jax.files.settings import ConfigError
    from gash_jax.formats.animations import load_animation
    from gash_jax.formats.hdr import write_hdr
    from gash_jax.formats.meshes import load_mesh, read_mesh, save_mesh
    from gash_jax.geometry.animation import Animation
    from gash_jax.geometry.health import HealthReport
    from gash_jax.geometry.mesh import Mesh, MeshError
    from gash_jax.light.brdf import Lobe, ggx, phong
    from gash_jax.light.compression import (
        Compressed,
        compress_light,
        compress_transfer,
        expand_light,
        expand_transfer,
    )
    from gash_jax.light.conversion import from_convention, to_convention
    from gash_jax.light.environment import Light, load_light, project_light, rotate_light, save_light
    from gash_jax.light.shading import shade, shade_texture
    from gash_jax.light.sky import sun_sky_light
    from gash_jax.light.sources import constant_light, directional_light, sphere_light
    from gash_jax.light.studio import studio_light
    from gash_jax.light.windows import light_window
    from gash_jax.models.deforming import deforming_predictor
    from gash_jax.models.guided import bake_guided, bake_to_error
    from gash_jax.models.model import Model, load_model
    from gash_jax.prt.bake import bake_transfer
    from gash_jax.prt.glossy import glossy_matrices
    from gash_jax.prt.plan import plan_bake
    from gash_jax.prt.rotation import rotate_transfer
    from gash_jax.prt.texture import TransferTexture, load_texture, save_texture
    from gash_jax.prt.texture_bake import bake_texture
    from gash_jax.prt.transfer import Transfer, load_transfer, save_transfer
    from gash_jax.shapes.procedural import make_shape
    from gash_jax.train.config import RunConfig, load_config
    from gash_jax.train.run import run_config

__version__ = version("gash-jax")

_HOMES = {
    "algebra.cga": ("geometric_product",),
    "algebra.motors": ("embed_point", "motor", "motor_to_rigid", "rotor_from_normal", "rotor_to_matrix"),
    "algebra.closed_forms": ("unshadowed_transfer",),
    "apps.pictures.render": ("render",),
    "apps.pictures.show": ("show",),
    "apps.viewer.page": ("Page", "view"),
    "geometry.animation": ("Animation",),
    "geometry.health": ("HealthReport",),
    "geometry.mesh": ("Mesh", "MeshError"),
    "formats.animations": ("load_animation",),
    "formats.hdr": ("write_hdr",),
    "formats.meshes": ("load_mesh", "read_mesh", "save_mesh"),
    "files.atomic": ("FileError",),
    "files.caches": ("keep_compiled_programs",),
    "files.settings": ("ConfigError",),
    "train.config": ("RunConfig", "load_config"),
    "train.run": ("run_config",),
    "shapes.procedural": ("make_shape",),
    "light.studio": ("studio_light",),
    "models.deforming": ("deforming_predictor",),
    "models.guided": ("bake_guided", "bake_to_error"),
    "models.model": ("Model", "load_model"),
    "prt.bake": ("bake_transfer",),
    "prt.glossy": ("glossy_matrices",),
    "light.brdf": ("Lobe", "ggx", "phong"),
    "light.conversion": ("from_convention", "to_convention"),
    "light.compression": (
        "Compressed",
        "compress_light",
        "compress_transfer",
        "expand_light",
        "expand_transfer",
    ),
    "light.environment": ("Light", "load_light", "project_light", "rotate_light", "save_light"),
    "prt.plan": ("plan_bake",),
    "prt.rotation": ("rotate_transfer",),
    "light.sky": ("sun_sky_light",),
    "light.sources": ("constant_light", "directional_light", "sphere_light"),
    "light.windows": ("light_window",),
    "prt.texture": ("TransferTexture", "load_texture", "save_texture"),
    "prt.texture_bake": ("bake_texture",),
    "light.shading": ("shade", "shade_texture"),
    "prt.transfer": ("Transfer", "load_transfer", "save_transfer"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Animation",
    "Compressed",
    "ConfigError",
    "FileError",
    "HealthReport",
    "Light",
    "Lobe",
    "Mesh",
    "MeshError",
    "Model",
    "Page",
    "RunConfig",
    "Transfer",
    "TransferTexture",
    "bake_guided",
    "bake_texture",
    "bake_to_error",
    "bake_transfer",
    "compress_light",
    "compress_transfer",
    "constant_light",
    "deforming_predictor",
    "directional_light",
    "embed_point",
    "from_convention",
    "expand_light",
    "expand_transfer",
    "geometric_product",
    "ggx",
    "glossy_matrices",
    "keep_compiled_programs",
    "light_window",
    "load_animation",
    "load_config",
    "load_light",
    "load_mesh",
    "load_model",
    "load_texture",
    "load_transfer",
    "make_shape",
    "motor",
    "motor_to_rigid",
    "phong",
    "plan_bake",
    "project_light",
    "read_mesh",
    "render",
    "rotate_light",
    "rotate_transfer",
    "rotor_from_normal",
    "rotor_to_matrix",
    "run_config",
    "save_light",
    "save_mesh",
    "save_texture",
    "save_transfer",
    "shade",
    "shade_texture",
    "show",
    "sphere_light",
    "studio_light",
    "to_convention",
    "sun_sky_light",
    "unshadowed_transfer",
    "view",
    "write_hdr",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'gash_jax' has no attribute {name!r}")
    return getattr(import_module(f"gash_jax.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
