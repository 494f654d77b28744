"""Closed loops on fabricated seams: how well the torch is led, and how well it knows."""

from dataclasses import replace

import numpy as np
import pytest

from tracking.seam_plant import (
    LOOK_AHEAD_M,
    Plant,
    Weld,
    drift_vector,
    misplaced,
    no_drift,
    path,
    saturating,
    sight,
    steady,
    weld,
)
from weldcell.tracking.seam_tracker import SeamTracker
from weldcell.tracking.sighting import TrackerSettings

PATHS = {kind: path(kind) for kind in ("straight", "s")}
SHORT = path("straight", 0.200)
WELD_S = 30.0


def _plant(kind: str, drift: str, seed: int) -> Plant:
    """10 mm and 3 degrees off, 10 frames a second, 10 % lost, 5 % strays, 6 mm hidden, noise of 0.03 to 0.1 mm."""
    rng = np.random.default_rng([seed, 1])
    where, size_m = misplaced(rng), drift_vector(rng)
    drifts = {"none": no_drift, "steady": steady(size_m, WELD_S), "saturating": saturating(size_m, rng.uniform(6, 12))}
    hidden_m = float(rng.uniform(0.08, 0.24))
    return Plant(
        taught=PATHS[kind],
        **where,
        noise_m=float(rng.uniform(0.03e-3, 0.1e-3)),
        latency_s=float(rng.uniform(0.03, 0.1)),
        hidden_m=(hidden_m, hidden_m + 6e-3),
        drift=drifts[drift],
    )


def _bent(plant: Plant, seed: int) -> Plant:
    """A part that is not quite as drawn: three waves of 0.03 mm together (root mean square)."""
    rng = np.random.default_rng([seed, 2])
    waves_m, phase = 0.03e-3 * np.sqrt(2 / 3) * rng.normal(size=(3, 2)), rng.uniform(0, 2 * np.pi, (3, 2))

    def shape(arc_length_m: np.ndarray) -> np.ndarray:
        turns = arc_length_m[:, None, None] / np.array([0.09, 0.15, 0.25])[:, None]
        return (waves_m * np.sin(2 * np.pi * turns + phase)).sum(axis=1)

    return replace(plant, shape=shape)


CASES = [("straight", "steady"), ("s", "none"), ("s", "saturating")]


@pytest.fixture(scope="module")
def welds() -> dict[tuple[str, str], Weld]:
    """A run of each case, with its seed."""
    return {case: weld(_plant(*case, seed), TrackerSettings(), seed) for seed, case in enumerate(CASES, start=1)}


def _errors_mm(run: Weld) -> tuple[np.ndarray, np.ndarray]:
    """Mean and largest error, lateral and vertical."""
    errors = 1e3 * np.abs(run.errors_m)
    return errors.mean(axis=0), errors.max(axis=0)


def _in_sigmas(runs: list[Weld]) -> float:
    """Root mean square error of runs, in predicted sigmas."""
    errors = np.concatenate([run.errors_m for run in runs])
    return float(np.sqrt((errors**2).mean() / np.concatenate([run.sigma_m**2 for run in runs]).mean()))


def test_a_straight_seam_is_followed_while_it_drifts(welds):
    """As far as the run-in tells a slope from a drift: two sigmas of 0.45 times a noise of 0.1 mm (60 frames)."""
    run = welds["straight", "steady"]
    mean_mm, largest_mm = _errors_mm(run)
    assert run.tracker.state == "end"
    assert np.all(mean_mm < 0.09)
    assert np.all(largest_mm < 0.25)


@pytest.mark.parametrize(("drift", "allowed_mm"), [("none", 0.05), ("saturating", 0.12)])
def test_a_bending_seam_is_followed_as_well_as_can_be_known(welds, drift, allowed_mm):
    """What drifts along the seam where the light is goes across it where the torch is: no frame shows that."""
    run = welds["s", drift]
    mean_mm, largest_mm = _errors_mm(run)
    assert run.tracker.state == "end"
    assert np.all(mean_mm < allowed_mm)
    assert np.all(largest_mm < 0.4)


def test_the_predicted_sigma_is_that_of_the_errors(welds):
    """Root mean square over runs on bent parts (errors of one run hang together), and never too small on drawn ones."""
    runs = [
        weld(_bent(_plant(kind, "steady", seed), seed), TrackerSettings(), seed) for seed, kind in enumerate(PATHS, 7)
    ]
    assert 0.6 < _in_sigmas(runs) < 1.6
    assert _in_sigmas(list(welds.values())) < 1.6


def test_the_estimated_drift_is_the_drift_where_it_shows(welds):
    """Along a straight seam nothing shows it; across, a slope of 1 mrad in the run-in is a drift of 10 um a second."""
    run, plant = welds["straight", "steady"], _plant("straight", "steady", 1)
    time_s = np.array([0.0, 5.0, 10.0, 20.0])
    off = (run.tracker.drift_m(time_s) - plant.drift(time_s)) @ plant.taught.lefts_base[0]
    assert np.abs(off - off.mean()).max() < 0.2e-3


@pytest.mark.parametrize("seed", [19, 20])
def test_a_seam_is_followed_at_100_mm_a_second(seed):
    plant = replace(_plant(("straight", "s")[seed % 2], "steady", seed), speed_m_s=0.1, rate_hz=30.0, run_in_m=0.09)
    run = weld(plant, TrackerSettings(), seed)
    mean_mm, largest_mm = _errors_mm(run)
    assert run.tracker.state == "end"
    assert np.all(mean_mm < 0.08)
    assert np.all(largest_mm < 0.25)


def test_without_a_model_of_the_drift_the_torch_is_late_by_the_look_ahead():
    """Rate times look-ahead over speed: 2 mm in 30 s, 60 mm at 10 mm/s: 0.4 mm."""
    plant = Plant(taught=SHORT, drift=steady(np.array([0.0, 0.0, 2e-3]), WELD_S), noise_m=0.03e-3, rate_hz=5.0)
    late, led = (weld(plant, TrackerSettings(drift=drift), 1) for drift in (False, True))
    settled = late.arc_length_m > 2 * LOOK_AHEAD_M
    expected_m = -2e-3 / WELD_S * LOOK_AHEAD_M / plant.speed_m_s
    assert np.mean(late.errors_m[settled, 1]) == pytest.approx(
        expected_m, abs=0.05e-3
    )  # what a turn of the part takes on
    assert abs(np.mean(led.errors_m[settled, 1])) < 0.05e-3
    assert np.abs(late.errors_m[:, 0]).mean() < 0.03e-3  # nothing drifts to the side


def test_exact_sightings_lead_to_the_exact_seam():
    rng = np.random.default_rng(6)
    plant = Plant(taught=PATHS["s"], **misplaced(rng), noise_m=1e-6, lost_share=0, stray_share=0, rate_hz=5)
    run = weld(plant, TrackerSettings(drift=False), 1)
    assert np.abs(run.errors_m).max() < 5e-6  # m; the sightings' own 1 um and 10 um granted to the arm


def test_late_and_shuffled_frames_tell_the_same():
    rng = np.random.default_rng(8)
    plant = Plant(taught=PATHS["straight"], **misplaced(rng), drift=steady(drift_vector(rng), WELD_S), stray_share=0)
    sightings = [sight(plant, float(time_s), rng) for time_s in np.arange(-6.5, 2.5, 0.1)]
    curves = []
    for order in (np.arange(len(sightings)), np.arange(len(sightings)).reshape(-1, 5)[:, ::-1].ravel()):
        tracker = SeamTracker(plant.taught, TrackerSettings())
        for index in order:
            tracker.observe(sightings[index])
        curves.append(tracker.curve(np.arange(0.02, 0.07, 0.01), 2.5)[0])
        assert tracker.state == "tracking"
    assert np.abs(curves[0] - curves[1]).max() < 10e-6  # m; robust weights of the points that settled, and first points


def test_strays_and_unsure_sightings_do_not_enter():
    rng = np.random.default_rng(9)
    plant = Plant(taught=PATHS["straight"], stray_share=0.0, lost_share=0.0)
    tracker = SeamTracker(plant.taught, TrackerSettings())
    for time_s in np.arange(-6, 0, 0.1):
        tracker.observe(sight(plant, float(time_s), rng))
    count, before = len(tracker.buffer), tracker.target(0.03, 0.0)
    good = sight(plant, 0.05, rng)
    tracker.observe(replace(good, point_base=good.point_base + [0, 0, 2e-3]))
    tracker.observe(replace(good, confidence=0.2))
    after = tracker.target(0.03, 0.0)
    assert len(tracker.buffer) == count
    assert (after.lateral_m, after.vertical_m) == (before.lateral_m, before.vertical_m)
    tracker.observe(good)
    assert len(tracker.buffer) == count + 1


def test_a_target_is_the_same_between_two_frames_as_worked_out():
    """The kept stretch ahead is linear between its nodes: to a micrometre."""
    rng = np.random.default_rng(10)
    plant = Plant(taught=PATHS["s"], **misplaced(rng), drift=steady(drift_vector(rng), WELD_S))
    tracker = SeamTracker(plant.taught, TrackerSettings())
    for time_s in np.arange(-6, 4, 0.1):
        tracker.observe(sight(plant, float(time_s), rng))
    for torch_m, arc_s in ((0.0401, 4.01), (0.0417, 4.17), (0.0466, 4.2)):
        target = tracker.target(torch_m, arc_s)
        (expected,), (sigma_m,) = tracker.curve(np.array([torch_m]), arc_s)
        assert np.allclose([target.lateral_m, target.vertical_m, target.sigma_m], [*expected, sigma_m], atol=1e-6)
        place = plant.taught.project(target.point_base[None])
        assert np.allclose(np.ravel(place), [torch_m, target.lateral_m, target.vertical_m], atol=1e-8)


def test_a_part_that_is_not_as_drawn_is_followed():
    """Bent by 0.5 mm over its length and drawn by a tack, 0.3 mm within 25 mm: ten times what is expected at first."""

    def shape(arc_length_m: np.ndarray) -> np.ndarray:
        share = arc_length_m / 0.2
        tack = 0.3e-3 * np.exp(-0.5 * ((arc_length_m - 0.11) / 0.012) ** 2)
        return np.column_stack([0.5e-3 * 4 * share * (1 - share) + tack, 0 * share])

    run = weld(Plant(taught=SHORT, shape=shape, rate_hz=5.0), TrackerSettings(drift=False), 1)
    mean_mm, largest_mm = _errors_mm(run)
    assert run.tracker.state == "end"
    assert mean_mm[0] < 0.03  # half of the noise
    assert largest_mm[0] < 0.1
