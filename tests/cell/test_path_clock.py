"""The time law: bounded, smooth, and at rest where it should be."""

import numpy as np
import pytest

from weldcell.cell.errors import BadInput
from weldcell.cell.world.path_clock import PathClock

STEP_S = 1e-3


def run(clock: PathClock, steps: int):
    return clock.advance(STEP_S, steps)


def test_it_comes_up_to_speed_and_keeps_it():
    times = run(PathClock(0.1, 1.0), 400)
    assert times.speed_m_s[-1] == 0.1
    assert np.abs(times.acceleration_m_s2).max() == pytest.approx(1.0, rel=1e-4)  # its peak lies between two steps
    # by hand: 0.15 s at half the speed, 0.25 s at full speed
    assert times.arc_length_m[-1] == pytest.approx(0.5 * 0.1 * 0.15 + 0.1 * 0.25, abs=1e-12)


def test_speed_and_acceleration_are_the_derivatives_of_the_way():
    clock = PathClock(0.1, 1.0)
    parts = [run(clock, 100)]
    clock.change_speed(0.03)
    parts.append(run(clock, 60))
    clock.brake()
    parts.append(run(clock, 150))
    way, speed, acceleration = (np.concatenate(column) for column in zip(*parts, strict=True))
    mid_speed = np.diff(way) / STEP_S
    assert mid_speed == pytest.approx(0.5 * (speed[1:] + speed[:-1]), abs=1e-5)  # m/s: jerk x step^2 / 12, and corners
    assert np.diff(speed) / STEP_S == pytest.approx(0.5 * (acceleration[1:] + acceleration[:-1]), abs=0.5)  # m/s2
    assert np.abs(acceleration).max() <= 1.0 + 1e-9
    assert speed[-1] == 0 and np.all(np.diff(way) >= 0)


@pytest.mark.parametrize(("speed_m_s", "acceleration_m_s2"), [(0.01, 0.5), (0.1, 1.0), (0.05, 0.2)])
def test_a_stop_takes_the_way_that_is_said(speed_m_s, acceleration_m_s2):
    clock = PathClock(speed_m_s, acceleration_m_s2)
    run(clock, 1000)
    before_m = clock.arc_length_m
    assert clock.stop_distance_m == pytest.approx(0.75 * speed_m_s**2 / acceleration_m_s2)
    said_m = clock.stop_distance_m
    clock.brake()
    assert clock.stopping and not clock.stopped
    times = run(clock, 1000)
    assert clock.stopped and clock.stop_distance_m == 0
    assert clock.arc_length_m - before_m == pytest.approx(said_m, abs=1e-12)
    assert np.abs(times.acceleration_m_s2).max() <= acceleration_m_s2


def test_a_stop_while_speeding_up_keeps_the_bound():
    clock = PathClock(0.1, 1.0)
    run(clock, 70)
    said_m, before_m = clock.stop_distance_m, clock.arc_length_m
    clock.brake()
    times = run(clock, 300)
    assert clock.stopped
    assert clock.arc_length_m - before_m == pytest.approx(said_m, abs=1e-12)
    assert np.abs(times.acceleration_m_s2).max() <= 1.0


def test_braking_again_does_not_prolong_the_stop():
    once, often = PathClock(0.1, 1.0), PathClock(0.1, 1.0)
    for clock in (once, often):
        run(clock, 300)
        clock.brake()
    for _ in range(200):
        often.brake()
        run(often, 1)
    run(once, 200)
    assert often.stopped and often.arc_length_m == once.arc_length_m


@pytest.mark.parametrize("end_m", [0.300, 0.02, 0.012, 0.003, 1e-4])
@pytest.mark.parametrize("step_s", [1e-3, 8e-3])
def test_it_rests_exactly_at_the_paths_end(end_m, step_s):
    clock = PathClock(0.1, 1.0, end_m=end_m)
    times = clock.advance(step_s, int(6 / step_s))
    assert clock.stopped
    assert clock.arc_length_m == pytest.approx(
        end_m, abs=1e-9 if end_m > 1e-3 else 1e-5
    )  # m: some steps are all of a short way
    assert np.abs(times.acceleration_m_s2).max() <= 1.0 + 1e-9
    assert times.arc_length_m.max() <= clock.arc_length_m + 1e-15


def test_the_way_does_not_depend_on_the_stretches_it_is_asked_in():
    whole, pieces = PathClock(0.1, 1.0, end_m=0.05), PathClock(0.1, 1.0, end_m=0.05)
    one = run(whole, 900)
    other = [run(pieces, count) for count in (1, 299, 400, 200)]
    for k in range(3):
        assert np.array_equal(one[k], np.concatenate([part[k] for part in other]))


@pytest.mark.parametrize(("speed", "acceleration"), [(0, 1), (-0.1, 1), (0.1, 0), (np.nan, 1), (0.1, np.inf)])
def test_a_clock_that_cannot_run_is_refused(speed, acceleration):
    with pytest.raises(BadInput, match="path clock"):
        PathClock(speed, acceleration)
