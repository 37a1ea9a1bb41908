"""Pictures from Python: what is drawn, how it is exposed and turned, and what is refused."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import gash_jax
from gash_jax.apps.pictures.render import drawn_mesh
from gash_jax.apps.pictures.show import show
from gash_jax.apps.pictures.views import GROUND
from gash_jax.shapes.primitives import bumpy_sphere, icosphere

BALL = gash_jax.bake_transfer(icosphere(3), 2, 16)
# bright from +x alone, as far as two bands can say it
RIGHT = np.zeros((4, 3), np.float32)
RIGHT[0], RIGHT[3] = 1.0, 1.0


def _halves(image: np.ndarray) -> tuple[float, float]:
    """Mean of the middle rows, left and right half of the ball."""
    rows = image[len(image) // 2 - 4 : len(image) // 2 + 4, 8:-8]
    return float(rows[:, : rows.shape[1] // 2].mean()), float(rows[:, rows.shape[1] // 2 :].mean())


def test_light_from_the_right_is_on_the_right_and_turns() -> None:
    left, right = _halves(gash_jax.render(BALL, RIGHT, size=64))
    assert right > 1.3 * left
    turned = gash_jax.render(
        BALL, RIGHT, rotation=np.diag([-1.0, 1.0, -1.0]), size=64
    )  # what came from x comes from -x
    left, right = _halves(turned)
    assert left > 1.3 * right
    left, right = _halves(gash_jax.render(BALL, RIGHT, camera="back", size=64))
    assert left > 1.3 * right
    np.testing.assert_array_equal(
        gash_jax.render(BALL, RIGHT, camera="back", size=32), gash_jax.render(BALL, RIGHT, camera=(180, 8), size=32)
    )


def test_radiance_one_at_exposure_one_is_white_and_half_is_its_srgb_value() -> None:
    light = gash_jax.Light(np.array([[2 * np.sqrt(np.pi)] * 3] + [[0.0] * 3] * 3))
    for exposure, value in ((1.0, 255), (0.5, 188), (np.float32(0.5), 188)):
        image = gash_jax.render(BALL, light, exposure=exposure, size=33)
        assert image.shape == (33, 33, 3) and image.dtype == np.uint8
        assert abs(int(image[16, 16, 0]) - value) <= 1
    grey = gash_jax.render(BALL, light, exposure=1.0, albedo=np.array([0.5, 1, 0]), size=33)[16, 16]
    assert abs(int(grey[0]) - 188) <= 1 and grey[1] >= 254 and grey[2] == 0
    corner = gash_jax.render(BALL, light, exposure=1.0, size=33)[0, 0]
    assert abs((corner[0] / 255) ** 2.2 - GROUND[0]) < 0.02


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"camera": "behind"}, "camera is 'behind': use front, side, back"),
        ({"camera": (0, 90)}, "elevation within 90"),
        ({"camera": (0, np.nan)}, "camera"),
        ({"size": 8}, "size is 8: use a whole number from 16 to 4096"),
        ({"size": 64.5}, "size is 64.5"),
        ({"exposure": 0}, "exposure is 0: use a number above 0"),
        ({"exposure": float("nan")}, "exposure is nan"),
        ({"rotation": np.ones((3, 3))}, "proper rotation"),
        ({"albedo": np.ones(7)}, "albedo has shape"),
    ],
)
def test_options_out_of_range_are_refused_in_one_line(options: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        gash_jax.render(BALL, RIGHT, **options)
    assert "\n" not in str(caught.value)


def test_what_has_no_mesh_cannot_be_drawn() -> None:
    with pytest.raises(ValueError, match="a ndarray has no mesh to draw: give the Transfer"):
        drawn_mesh(BALL.coefficients)
    for draw in (lambda t: gash_jax.render(t, RIGHT), show):
        with pytest.raises(ValueError, match="no faces"):
            draw(gash_jax.bake_transfer(icosphere(2), 2, 16, rows=slice(0, 5)))


def test_a_figure_has_a_colour_bar_for_every_map_and_draws_itself() -> None:
    mesh = bumpy_sphere(8)
    baked = gash_jax.bake_transfer(mesh, 2, 16)
    figure = show(baked._replace(predicted_error=np.abs(baked.coefficients)))
    assert isinstance(figure, Figure) and figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    titles = [axis.get_title() for axis in figure.axes if axis.get_title()]
    assert titles[:4] == ["relit, front", "relit, side", "relit, back", "relit, top"]
    assert titles[-2:] == ["standard error (rms)", "predicted error (rms)"] and len(titles) == 10
    bars = [axis for axis in figure.axes if axis.get_label() == "<colorbar>"]
    assert len(bars) == len(titles) - 4
    plain = show(gash_jax.bake_transfer(mesh, 1, 8))  # one band, no error
    assert [axis.get_title() for axis in plain.axes if axis.get_title()][4:] == ["seen sky (1 = all of it)"]


def test_coloured_transfer_is_drawn_too() -> None:
    coloured = BALL._replace(coefficients=np.repeat(BALL.coefficients[..., None], 3, axis=2), standard_error=None)
    np.testing.assert_array_equal(gash_jax.render(coloured, RIGHT, size=32), gash_jax.render(BALL, RIGHT, size=32))
    assert show(coloured).axes
