"""One least squares estimate of camera and target from all sights, with one target or with two."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.calib.hand_eye import HandEyeProblem
from weldcell.calib.least_squares import Fit, Model, fit
from weldcell.calib.sight_model import (
    lever_m,
    mount_model,
    perturbed,
    sight_blocks,
    targets_base,
)
from weldcell.calib.verdict import Block, Observability, observe

SIGMA_M = 1e-6  # promised, so that the residuals' own spread decides the covariance
_ROUNDS = 2  # the second starts its perturbation anew from zero, where the covariance is defined


@dataclass(frozen=True, kw_only=True, eq=False)
class JointEstimate:
    """One least squares estimate over rows with one target or two."""

    T_flange_camera: RigidTransform
    targets_base: Float[np.ndarray, "g 3"]
    places: Int[np.ndarray, "k"]
    """Which target each row saw."""
    found: Fit
    seen: Observability

    @property
    def rms_m(self) -> float:
        return float(np.sqrt(np.mean(np.sum(self.found.residuals**2, axis=1)))) * SIGMA_M

    @property
    def freedom(self) -> int:
        return self.found.residuals.size - len(self.found.parameters)


def joint_estimate(
    problem: HandEyeProblem, T_flange_camera: RigidTransform, places: Int[np.ndarray, "n"]
) -> JointEstimate:
    """The least squares estimate near `T_flange_camera`; `places` says which target each row saw (0, 1)."""
    count = int(places.max()) + 1
    targets = targets_base(problem.T_base_flange, T_flange_camera, problem.centres_camera)
    means = np.array([targets[places == place].mean(axis=0) for place in range(count)])
    for _ in range(_ROUNDS):
        start = np.concatenate([np.zeros(6), means.ravel()])
        found = fit(_model(problem, T_flange_camera, places), start, robust=False)
        T_flange_camera = perturbed(T_flange_camera, found.parameters[:6])
        means = found.parameters[6:].reshape(-1, 3)
    jacobian = found.jacobian.reshape(-1, len(found.parameters)) * SIGMA_M
    names = ("target along",) if count == 1 else ("the translations' target along", "the free poses' target along")
    blocks = [*sight_blocks(lever_m(problem.centres_camera))[:2], *(Block(name=name, frame="base") for name in names)]
    return JointEstimate(
        T_flange_camera=T_flange_camera,
        targets_base=means,
        places=places,
        found=found,
        seen=observe(jacobian, blocks),
    )


def _model(problem: HandEyeProblem, T_start: RigidTransform, places: Int[np.ndarray, "n"]) -> Model:
    """Residuals in sigmas by a perturbation of `T_start` and the targets, with derivatives."""
    sights = mount_model(problem.T_base_flange, T_start, problem.centres_camera)
    rows = np.arange(len(places))

    def model(parameters: Float[np.ndarray, "p"]) -> tuple[np.ndarray, np.ndarray]:
        seen_base, by_mount = sights(parameters[:6])
        by_targets = np.zeros((len(rows), 3, (len(parameters) - 6) // 3, 3))
        by_targets[rows, :, places] = -np.eye(3)
        jacobian = np.concatenate([by_mount, by_targets.reshape(len(rows), 3, -1)], axis=-1)
        residuals = seen_base - parameters[6:].reshape(-1, 3)[places]
        return residuals / SIGMA_M, jacobian / SIGMA_M

    return model
