"""The scenarios that can be run."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module

from weldcell.cell.errors import BadInput
from weldcell.scenarios.job import Job, Outcome


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A recipe by name; its module is only imported when it runs, so that listing needs no simulator."""

    name: str
    summary: str
    """One line for `weldcell list`."""
    module: str
    """Where the recipe's `run(job: Job) -> Outcome` stands."""

    def run(self, job: Job) -> Outcome:
        """What the recipe measured."""
        outcome: Outcome = import_module(self.module).run(job)
        return outcome


SCENARIOS = (
    Scenario(
        name="commission",
        summary="the main job: calibrate, compensate, verify, track the S-shaped V-groove, scan the boss",
        module="weldcell.scenarios.commission",
    ),
    Scenario(
        name="hand-eye-sphere",
        summary="hand-eye on the standard sphere, compensation by torch touches, errors near and far",
        module="weldcell.scenarios.hand_eye_sphere",
    ),
    Scenario(
        name="hand-eye-point",
        summary="hand-eye on a fixed point with P1's sensor: pure translations, free poses, two steps",
        module="weldcell.scenarios.hand_eye_point",
    ),
    Scenario(
        name="laser-plane",
        summary="camera and light plane by boards: vanishing point, board, dual step and bundle compared",
        module="weldcell.scenarios.laser_plane",
    ),
    Scenario(
        name="v-seam",
        summary="scan the S-shaped V-groove: left edge, root and right edge against the exact seam",
        module="weldcell.scenarios.v_seam",
    ),
    Scenario(
        name="u-seam",
        summary="scan P1's U seam on a free-form surface: by the joint's finder, and by P1's morphology",
        module="weldcell.scenarios.u_seam",
    ),
    Scenario(
        name="weld",
        summary="weld a misplaced, drifting part in closed loop: torch error against the exact seam",
        module="weldcell.scenarios.weld",
    ),
    Scenario(
        name="boss",
        summary="scan the boss: its slanted edges and dihedral angles",
        module="weldcell.scenarios.boss",
    ),
)


def find_scenario(name: str, scenarios: Iterable[Scenario]) -> Scenario:
    """The scenario of that name, refused with the nearest known one."""
    known = {scenario.name: scenario for scenario in scenarios}
    if name in known:
        return known[name]
    raise BadInput(f"SCENARIO: found {name!r}, expected one of {', '.join(known)}{did_you_mean(name, known)}")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint at the nearest of the known names; empty if none is near."""
    nearest = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f" (did you mean {nearest[0]}?)" if nearest else ""
