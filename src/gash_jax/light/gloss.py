"""Light that a glossy surface reflects towards a viewer, from glossy transfer and a lobe.

    radiance towards v = sum_i k_l (M L)_i Y_i(r),      r = 2 (n.v) n - v,

M the matrices of the vertex (`prt.glossy`), L the light, k_l the lobe's factors: the lobe about the mirror direction r
of what arrives, V and the horizon included, with no further cosine (Sloan et al. 2002, section 5). All three are cut to
B bands, so the sum is the integral of K_B V [n.w > 0] L_B exactly. It is not the prefiltered map, which knows neither
horizon nor shadow.

M is never formed: with the light's multiplier A_jic = sum_k G_ikj L_kc (`algebra.gaunt`) M L is one product of the
visibility's coefficients with a small matrix. Where M L is there already, as `models.deforming_model` says it of a
pose, `reflected_radiance` is the rest of the sum.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, as_array, is_real, shown
from gash_jax.algebra.gaunt import multiplier
from gash_jax.algebra.numerics import safe_normalize
from gash_jax.algebra.sh import band_index, bands_of, evaluate_sh
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.brdf import Lobe
from gash_jax.prt.glossy import glossy_arrays
from gash_jax.prt.transfer import Transfer


def arriving_radiance(transfer: object, light: Float[Array, "k 3"]) -> Float[Array, "v k 3"]:
    """(M L)_i: what arrives at each vertex, in B bands."""
    visibility, matrices = glossy_arrays(transfer)
    if visibility is None:
        return jnp.einsum("vij,jc->vic", matrices, light, precision="highest")
    return seen_radiance(visibility, light)


def seen_radiance(visibility: Float[Array, "v j"], light: Float[Array, "k 3"]) -> Float[Array, "v k 3"]:
    """(M L)_i from the visibility in 2B - 1 bands."""
    product = multiplier(light)
    flat = jnp.matmul(visibility, product.reshape(len(product), -1), precision="highest")
    return flat.reshape(len(visibility), *light.shape)


def glossy_radiance(transfer: object, light: Float[Array, "k 3"], view: object, lobe: object) -> Float[Array, "v 3"]:
    """Radiance towards the viewer (module docstring), `light` in the bands of the transfer; `shade` says what `view`
    and `lobe` may be."""
    if view is None:
        raise ValueError(
            "a lobe shines towards a viewer: give view, the position of a camera (3,) or a direction towards it for "
            "each vertex (v, 3)"
        )
    arriving = arriving_radiance(transfer, light)
    assert isinstance(transfer, Transfer)  # else it has been refused
    return reflected_radiance(arriving, transfer.mesh, view, lobe)


def reflected_radiance(arriving: ArrayLike | Array, mesh: Mesh, view: object, lobe: object) -> Float[Array, "v 3"]:
    """Radiance towards the viewer of what arrives, (M L)_i of shape (v, k, 3), on a mesh with its normals; `shade` says
    what `view` and `lobe` may be. Raises ValueError for other shapes."""
    found = as_array(arriving)
    if found.ndim != 3 or found.shape[::2] != (len(mesh.vertices), 3) or not is_real(found):
        raise ValueError(
            f"radiance has shape {found.shape} {found.dtype}: give ({len(mesh.vertices)}, bands^2, 3), what arrives at "
            "each vertex of the mesh"
        )
    bands = bands_of(found.shape[1])
    factors = _factors(lobe, bands)
    normals, toward = jnp.asarray(mesh.normals), _toward(view, mesh)
    mirrored = 2 * jnp.sum(normals * toward, axis=-1, keepdims=True) * normals - toward
    weights = evaluate_sh(mirrored, bands) * factors[band_index(bands)][None]
    return jnp.einsum("vk,vkc->vc", weights, jnp.asarray(found, jnp.float32), precision="highest")


def _factors(lobe: object, bands: int) -> Float[Array, "b"]:
    if not isinstance(lobe, Lobe):
        raise ValueError(f"lobe is {shown(lobe)}: give a Lobe, as phong(exponent) and ggx(roughness) make it")
    found = as_array(lobe.factors)
    if found.ndim != 1 or not is_real(found) or len(found) < bands:
        raise ValueError(f"the lobe has factors {found.shape} {found.dtype}: give one for each of the {bands} bands")
    return jnp.asarray(found, jnp.float32)


def _toward(view: object, mesh: Mesh) -> Float[Array, "v 3"]:
    """Unit directions from the vertices towards the viewer."""
    vertices = jnp.asarray(mesh.vertices)
    found = as_array(view)
    if found.shape not in ((3,), vertices.shape) or not is_real(found):
        raise ValueError(
            f"view has shape {found.shape} {found.dtype}: give the position of a camera (3,), or a direction towards "
            f"it for each vertex {vertices.shape}"
        )
    seen = jnp.asarray(found, jnp.float32)
    return safe_normalize(seen[None] - vertices if seen.ndim == 1 else seen)
