"""The part that is not where it was said to be, and drifts while it is welded."""

import numpy as np
import pytest

from weldcell.cell.configuration import WeldConfig
from weldcell.cell.frames import translation
from weldcell.cell.seam import Seam
from weldcell.scenarios.welding.moving_part import MovingPart, drift_base, misplaced

CONFIG = WeldConfig(misplacement_mm=7.0, misplacement_deg=2.0, drift_mm=2.0)


def part(seed: int) -> MovingPart:
    told = translation([0.9, 0.1, 0.3])
    return MovingPart(
        T_base_told=told,
        misplacement=misplaced(CONFIG, seed),
        drift_base=drift_base(CONFIG, seed),
        weld_s=30.0,
        seam_part=Seam(arc_length_m=np.array([0.0, 0.3]), points={"middle": np.array([[0, 0, 0], [0.3, 0, 0.0]])}),
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_part_is_off_by_exactly_what_was_asked_for(seed):
    off = part(seed).T_base_told.inv() * part(seed).T_base_part(0.0)
    assert np.linalg.norm(off.translation) == pytest.approx(7e-3, abs=1e-12)  # m
    assert np.degrees(off.rotation.magnitude()) == pytest.approx(2.0, abs=1e-9)
    assert off.translation[2] == 0


@pytest.mark.parametrize("seed", range(5))
def test_it_drifts_by_what_was_asked_for_until_the_weld_is_over(seed):
    moving = part(seed)
    start, end = moving.T_base_part(0.0), moving.T_base_part(30.0)
    assert np.linalg.norm(end.translation - start.translation) == pytest.approx(2e-3, abs=1e-12)  # m
    assert (start.rotation.inv() * end.rotation).magnitude() < 1e-12


def test_it_does_not_move_before_the_arc_is_lit_and_fastest_right_after():
    moving = part(1)
    places = np.array([moving.T_base_part(t).translation for t in (-5.0, 0.0, 1.0, 15.0, 16.0)])
    np.testing.assert_array_equal(places[0], places[1])
    assert np.linalg.norm(places[2] - places[1]) > 2 * np.linalg.norm(places[4] - places[3])


def test_directions_are_drawn():
    towards = {tuple(np.round(drift_base(CONFIG, seed), 6)) for seed in range(20)}
    turned = {np.sign(misplaced(CONFIG, seed).rotation.as_rotvec()[2]) for seed in range(20)}
    assert len(towards) == 20 and turned == {-1.0, 1.0}
