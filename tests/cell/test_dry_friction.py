"""Dry friction: Dahl's closed forms."""

import numpy as np
import pytest

from weldcell.cell.world.dry_friction import DryFriction

COULOMB_NM = np.array([45.0, 30.0, 10.0, 3.0, 2.0, 1.0])
PRESLIDING_RAD = 5e-5


@pytest.fixture
def friction():
    return DryFriction(COULOMB_NM, PRESLIDING_RAD)


def test_a_sliding_joint_feels_coulomb_friction(friction):
    friction.turn(np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0]) * 1e-3)
    assert friction.torque_nm == pytest.approx(COULOMB_NM * [1, -1, 1, -1, 1, -1], rel=1e-8)  # exp(-20)


def test_a_joint_at_rest_starts_as_a_spring(friction):
    friction.turn(np.full(6, 1e-9))
    assert friction.torque_nm == pytest.approx(COULOMB_NM * 1e-9 / PRESLIDING_RAD, rel=1e-4)


def test_a_reversal_turns_it_round_over_the_presliding_way(friction):
    friction.turn(np.full(6, 1e-2))
    friction.turn(np.full(6, -PRESLIDING_RAD))
    assert friction.torque_nm == pytest.approx(COULOMB_NM * (2 / np.e - 1), rel=1e-9)


def test_it_depends_on_the_way_and_not_on_its_steps(friction):
    friction.turn(np.full(6, 3e-5))
    fine = DryFriction(COULOMB_NM, PRESLIDING_RAD)
    for _ in range(300):
        fine.turn(np.full(6, 1e-7))
    assert fine.torque_nm == pytest.approx(friction.torque_nm, rel=1e-10)


def test_swinging_to_and_fro_costs_force_times_way(friction):
    """Of a swing much wider than the presliding way; each reversal saves F z (1 + ...), some 1 % here."""
    way_rad = 1e-2 * np.sin(np.linspace(0, 4 * np.pi, 40_001))
    work_j, last = np.zeros(6), []
    for step_rad in np.diff(way_rad):
        before = friction.torque_nm
        friction.turn(np.full(6, step_rad))
        work_j += 0.5 * (before + friction.torque_nm) * step_rad
        last.append(work_j.copy())
    cycle_j = last[-1] - last[len(last) // 2 - 1]
    assert cycle_j == pytest.approx(4 * COULOMB_NM * 1e-2, rel=0.015)
