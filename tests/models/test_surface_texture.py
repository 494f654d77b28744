"""Textures: reproducible, of the statistics that they claim, and where the part's own coordinates put them."""

import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry
from weldcell.models.boss import boss
from weldcell.models.surface_texture import SurfaceTexture, even_spots, surface_texture
from weldcell.models.v_groove import v_groove_plate

LOW, HIGH = np.array([-0.05, -0.03, 0.0]), np.array([0.05, 0.03, 0.02])
UP, LEFT, AHEAD = np.eye(3)[[2, 1, 0]]


def texture(kind="brushed", seed=1, spots=()):
    points = np.array(spots, dtype=float).reshape(-1, 3)
    return surface_texture(LOW, HIGH, kind, points, np.random.default_rng(seed))


def ramp():
    """A texture whose brightness tells its row: 100 + row / 4."""
    rows = 600 + 3 * 200
    grey = np.broadcast_to((np.arange(rows) // 4)[:, None], (rows, 1000)).astype(np.uint8)
    return SurfaceTexture(grey=grey, low_part=LOW, high_part=HIGH, texel_m=1e-4)


@pytest.mark.parametrize("kind", ["brushed", "scratched"])
def test_the_same_seed_makes_the_same_surface(kind):
    np.testing.assert_array_equal(texture(kind).grey, texture(kind).grey)
    assert (texture(kind).grey != texture(kind, seed=2).grey).mean() > 0.5


@pytest.mark.parametrize("kind", ["none", "brushed", "scratched"])
def test_nothing_is_brighter_than_the_plain_material(kind):
    rng = np.random.default_rng(3)
    factor = texture(kind).factor(rng.uniform(LOW, HIGH, (5000, 3)), np.tile(UP, (5000, 1)))
    assert factor.min() > 0 and factor.max() <= 1
    assert (factor == 1).all() == (kind == "none")


def test_each_side_has_a_panel_of_its_own():
    """A point's row: y on top, z below it for walls that face right, the ends, walls that face left."""
    point = np.array([[0.01, -0.01, 0.005]])
    places = (UP, 600, 200), (-LEFT, 600, 600 + 50), (AHEAD, 200, 800 + 50), (LEFT, 600, 1000 + 50)
    for normal, column, row in places:
        np.testing.assert_allclose(ramp().places_px(point, normal[None])[0], [column - 0.5, row - 0.5], atol=1e-9)


def test_the_brightness_between_pixels_is_bilinear():
    rows = np.array([100.0, 103.0, 103.5, 104.0])  # 103 -> 104 is a step of one level in the ramp
    points = LOW + 1e-4 * np.column_stack([np.full(4, 50.0), rows + 0.5, np.zeros(4)])
    factor = ramp().factor(points, np.tile(UP, (4, 1)))
    np.testing.assert_allclose(255 * factor, [25, 25, 25.5, 26], atol=1e-6)


def test_brushed_lines_run_along_x_with_a_spectrum_of_one_over_f():
    """Neighbours 1 mm apart along a line agree, across they do not; the power falls with a slope of -1 +- 0.2 between
    0.4 and 10 mm (60 columns of 600 rows).
    """
    panel = texture("brushed").grey[:600].astype(float)
    panel -= panel.mean(axis=0)
    along = np.mean(panel[:, 10:] * panel[:, :-10]) / np.mean(panel**2)
    across = np.mean(panel[10:] * panel[:-10]) / np.mean(panel**2)
    assert along > 0.95 and across < 0.7
    power = np.mean(np.abs(np.fft.rfft(panel[:, ::17], axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(600, 1e-4)
    band = (frequency > 100) & (frequency < 2500)
    slope = np.polyfit(np.log(frequency[band]), np.log(power[band]), 1)[0]
    assert slope == pytest.approx(-1, abs=0.2)


def test_a_tack_spot_is_a_dark_disc_with_a_halo():
    """On top and on the walls, at its own distance from the centre; nothing beyond 14 mm."""
    spotted = texture("none", spots=[[0.01, 0.005, 0.0195]])  # half a millimetre from the panels' border
    for away, normal in ((LEFT, UP), (AHEAD, UP), (AHEAD, LEFT), (AHEAD, -LEFT)):
        ways_m = np.linspace(0, 0.02, 81)
        points = np.array([0.01, 0.005, 0.0195]) - ways_m[:, None] * away
        factor = spotted.factor(points, np.tile(normal, (81, 1)))
        assert factor[0] < 0.35 and (factor[ways_m > 0.014] == 1).all()
        turns = np.flatnonzero(np.diff(np.sign(np.diff(factor))[np.diff(factor) != 0]))
        assert len(turns) == 2  # brighter to the straw ring, darker to the blue one, brighter again


def test_a_deep_tack_spot_does_not_show_on_top():
    spot = np.array([[0.01, 0.005, 0.001]])
    spotted = texture("none", spots=spot)  # 19 mm below the top
    assert spotted.factor(spot, UP[None])[0] == 1
    assert spotted.factor(spot, LEFT[None])[0] < 0.35


def test_tack_spots_stand_evenly_along_the_root():
    plate = v_groove_plate(0.3, 0.16, 0.02, np.pi / 3, 0.0, 0.004, 0.02).with_surface("ground-steel", tack_spots=4)
    root = plate.seam_part.points["root"]
    spots = even_spots(root, 4)
    factor = plate.texture.factor(spots, np.tile(LEFT, (4, 1)))
    assert (factor < 0.4).all()
    apart_m = np.diff(spots[:, 0])  # along x, the way being S-shaped
    np.testing.assert_allclose(apart_m, (root[-1, 0] - root[0, 0]) / 4, rtol=0.05)
    assert plate.material == "ground-steel" and plate.seam_part is not None


def test_a_plain_part_has_no_texture():
    assert boss(0.05, 0.9, 0.04).with_surface("aluminium").texture is None


def test_spots_without_a_seam_and_parts_without_size_are_refused():
    with pytest.raises(BadGeometry, match="expected a seam, found none"):
        boss(0.05, 0.9, 0.04).with_surface("aluminium", tack_spots=2)
    with pytest.raises(BadGeometry, match="texture: expected a box"):
        surface_texture(LOW, LOW, "brushed", np.empty((0, 3)), np.random.default_rng(1))
    with pytest.raises(BadGeometry, match="more than"):
        surface_texture(LOW, 100 * HIGH + 5, "brushed", np.empty((0, 3)), np.random.default_rng(1))
    with pytest.raises(BadGeometry, match="pixels"):
        SurfaceTexture(grey=np.zeros((3, 3), np.uint8), low_part=LOW, high_part=HIGH, texel_m=1e-4)
