"""What frames and plates of a data set are drawn as."""

from dataclasses import fields, replace

import numpy as np
import pytest

from weldcell.cell.configuration import SENSOR_PRESETS, DatasetConfig, SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.scenarios.dataset.plan import FramePlan, plan_frame, plan_plate, plate_of, tilt

RANGES, SENSOR = DatasetConfig(), SensorConfig()


@pytest.fixture(scope="module")
def frames():
    return [plan_frame(RANGES, SENSOR, 3, k) for k in range(300)]


def test_a_frame_depends_on_its_number_and_the_seed_alone(frames):
    assert plan_frame(RANGES, SENSOR, 3, 17) == frames[17]
    assert plan_frame(RANGES, SENSOR, 4, 17) != frames[17]
    assert frames[16] != frames[17]
    assert plan_plate(RANGES, 3, 5) == plan_plate(RANGES, 3, 5) != plan_plate(RANGES, 3, 6)


def test_what_is_drawn_fills_its_range(frames):
    plates = [plan_plate(RANGES, 3, k) for k in range(300)]
    for plans, least_share in ((frames, 0.85), (plates, 0.85)):
        for field in fields(plans[0]):
            ends = getattr(RANGES, field.name, None)
            if not isinstance(ends, tuple) or isinstance(ends[0], str) or field.name == "root_gap_mm":
                continue
            values = [getattr(plan, field.name) for plan in plans]
            assert ends[0] <= min(values) and max(values) <= ends[1]
            assert max(values) - min(values) > least_share * (ends[1] - ends[0])  # 300 draws of a uniform number
    assert {plate.material for plate in plates} == set(RANGES.materials)
    assert {plate.texture for plate in plates} == set(RANGES.textures)
    gaps = np.array([plate.root_gap_mm for plate in plates])
    assert np.mean(gaps > 0) == pytest.approx(RANGES.root_gap_ratio, abs=0.1)  # 300 draws: 4 sigma
    assert gaps[gaps > 0].min() >= RANGES.root_gap_mm[0]


def test_disturbances_happen_as_often_as_they_should(frames):
    kinds = [disturbance.kind for plan in frames for disturbance in plan.disturbances]
    for kind, ratio in (("arc", RANGES.arc_ratio), ("fume", RANGES.fume_ratio), ("spatter", RANGES.spatter_ratio)):
        assert kinds.count(kind) / 300 == pytest.approx(ratio, abs=4 * np.sqrt(ratio / 300))
    assert "arc" not in {
        disturbance.kind
        for k in range(100)
        for disturbance in plan_frame(replace(RANGES, arc_ratio=0.0), SENSOR, 3, k).disturbances
    }


@pytest.mark.parametrize("preset", list(SENSOR_PRESETS))
def test_the_torch_stays_above_the_plate(preset):
    sensor = SENSOR_PRESETS[preset]
    for k in range(100):
        plan = plan_frame(RANGES, sensor, 1, k)
        tip = tilt(plan).apply([-1e-3 * sensor.look_ahead_mm, 0, -1e-3 * sensor.below_tip_mm])
        assert 1e-3 * plan.height_mm + tip[2] > 0.002


def test_ranges_that_put_the_torch_into_the_plate_are_refused():
    with pytest.raises(BadInput, match=r"dataset\.height_mm"):
        plan_frame(replace(RANGES, height_mm=(-60.0, -50.0)), SENSOR, 0, 0)


def test_a_range_whose_ends_are_turned_round_is_refused():
    with pytest.raises(BadInput, match=r"dataset\.lean_deg: found 5 to 1"):
        DatasetConfig(lean_deg=(5.0, 1.0))
    with pytest.raises(BadInput, match=r"dataset\.materials: found none"):
        DatasetConfig(materials=())


def test_the_torch_leans_and_turns_as_the_fields_say():
    """Travel along x: y is left. The wire (torch z) points forwards when it leans forwards, as in a scan's path."""
    upright = dict.fromkeys((field.name for field in fields(FramePlan)), 0.0) | {"disturbances": ()}
    small = np.sin(np.radians(1))

    def wire(**given):
        return tilt(FramePlan(**upright | given)).apply([0.0, 0, 1])

    np.testing.assert_allclose(wire(), [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(wire(lean_deg=1.0), [small, 0, -np.sqrt(1 - small**2)], atol=1e-12)
    np.testing.assert_allclose(wire(roll_deg=1.0), [0, -small, -np.sqrt(1 - small**2)], atol=1e-12)
    forward = tilt(FramePlan(**upright | {"yaw_deg": 90.0})).apply([1.0, 0, 0])
    np.testing.assert_allclose(forward, [0, 1, 0], atol=1e-12)


def test_frames_are_shared_out_to_plates_in_order():
    assert [plate_of(replace(RANGES, frames_per_plate=3), k) for k in range(7)] == [0, 0, 0, 1, 1, 1, 2]
