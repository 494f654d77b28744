"""How the actual robot and sensor differ from what the controller believes: the error budgets, drawn by seed."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import RobotTier
from weldcell.cell.frames import rigid_from
from weldcell.cell.world.numerical_inverse import NumericalInverse

JOINTS = 6


@runtime_checkable
class Axes(Protocol):
    """Anything that knows a six-axis arm's geometry at reading zero, such as `Controller` and `OwnArm`."""

    @property
    def axes_base(self) -> Float[np.ndarray, "6 3"]:
        """Joint axes."""
        ...

    @property
    def anchors_base(self) -> Float[np.ndarray, "6 3"]:
        """A point on each joint axis, m."""
        ...

    @property
    def T_base_flange_zero(self) -> RigidTransform:
        """Flange."""
        ...


@dataclass(frozen=True, kw_only=True)
class ErrorBudget:
    """Sizes of the errors of one tier; one sigma unless the field says otherwise."""

    link_m: float
    """Each coordinate of each link's origin in its parent."""
    twist_rad: float
    """Each link's axes, about each of the three axes."""
    zero_rad: float
    """Each joint's zero."""
    compliance_rad_per_nm: tuple[float, float]
    """Joint compliance under gravity, of axes 1 to 3 and 4 to 6."""
    repeatability_m: float
    """Pose repeatability RP of the flange as ISO 9283 defines it and data sheets give it: the mean distance from the
    mean place plus three of its standard deviations."""
    tip_m: float
    """Distance (not a sigma) of the actual torch tip from the nominal one; the direction is drawn."""
    focal_ratio: float
    """Focal length believed over actual, less one."""
    principal_px: float
    """Principal point."""
    plane_rad: float
    """Direction of the light plane."""
    plane_m: float
    """Place of the light plane."""
    mount_m: float
    """Sensor mount against the drawing: what hand-eye calibration has to find."""
    mount_rad: float
    """Sensor mount against the drawing."""
    friction_ratio: float
    """Each joint's friction over what the controller takes it for, less one: it changes with temperature and wear."""


_MOUNT = {"mount_m": 1.0e-3, "mount_rad": np.radians(0.5)}
# "As calibrated": 15 to 20 boards give 0.002 deg and 5 um of plane; focal length and centre as such boards do.
_CALIBRATED = {"focal_ratio": 1e-4, "principal_px": 0.15, "plane_rad": np.radians(0.002), "plane_m": 5e-6}
_EXACT = {"focal_ratio": 0.0, "principal_px": 0.0, "plane_rad": 0.0, "plane_m": 0.0}
# Chosen so that P2's error before compensation comes out as published (4 to 5 mm).
_OFF = {"focal_ratio": 1e-3, "principal_px": 1.0, "plane_rad": np.radians(0.03), "plane_m": 50e-6}


def _budget(
    link_mm: float, twist_deg: float, zero_deg: float, compliance_urad: tuple[float, float], repeatability_mm: float,
    tip_mm: float, friction_ratio: float, sensor: dict[str, float],
) -> ErrorBudget:  # fmt: skip
    return ErrorBudget(
        link_m=link_mm * 1e-3,
        twist_rad=float(np.radians(twist_deg)),
        zero_rad=float(np.radians(zero_deg)),
        compliance_rad_per_nm=(compliance_urad[0] * 1e-6, compliance_urad[1] * 1e-6),
        repeatability_m=repeatability_mm * 1e-3,
        tip_m=tip_mm * 1e-3,
        friction_ratio=friction_ratio,
        **sensor,
        **_MOUNT,
    )


BUDGETS: dict[RobotTier, ErrorBudget] = {
    "perfect": _budget(0, 0, 0, (0, 0), 0, 0, 0, _EXACT),
    "calibrated": _budget(0.1, 0.005, 0.005, (0.5, 2), 0.02, 0.2, 0.1, _CALIBRATED),
    "typical": _budget(0.3, 0.02, 0.03, (1.5, 6), 0.04, 0.5, 0.2, _CALIBRATED),
    "bad": _budget(0.5, 0.05, 0.1, (3, 12), 0.06, 1.0, 0.3, _CALIBRATED),
    "paper": _budget(0.5, 0.05, 0.1, (3, 12), 0.06, 4.0, 0.3, _OFF),
}


@dataclass(frozen=True, kw_only=True)
class RobotError:
    """One actual robot: drawn once for each seed."""

    link_m: Float[np.ndarray, "6 3"]
    """Added to each link's origin in its parent."""
    twist_rad: Float[np.ndarray, "6 3"]
    """Rotation vector applied to each link's frame."""
    zero_rad: Float[np.ndarray, "6"]
    """Actual joint angle at reading zero."""
    compliance_rad_per_nm: Float[np.ndarray, "6"]
    """Deflection of each joint for each newton-metre of its load."""
    repeatability_rad: float
    """One sigma of each joint at each new approach."""
    tip_flange_m: Float[np.ndarray, "3"]
    """Actual torch tip less nominal, in the flange frame."""
    T_camera_mount: RigidTransform
    """Actual camera frame in the drawing's camera frame."""
    focal_ratio: float
    """Believed focal length over actual, less one."""
    principal_px: Float[np.ndarray, "2"]
    """Believed principal point less actual."""
    plane_rad: Float[np.ndarray, "3"]
    """Rotation vector from the actual to the believed light plane."""
    plane_m: float
    """Believed offset of the light plane less actual."""
    friction_ratio: Float[np.ndarray, "6"]
    """Actual friction of each joint over that which the controller knows, less one."""


# RP of normal errors with one sigma on each axis, by the mean (1.596) and spread (0.673) of Maxwell's distribution.
_RP_PER_SIGMA = 1.596 + 3 * 0.673
# An equal sigma on all six joints moves the flange by this much for each radian (root mean square, the cell's own arm
# at a working posture, torch 0.93 m before the base): turns repeatability at the flange into joint noise. At `HOME_RAD`
# `flange_m_per_joint_rad` gives 1.49, over the table 1.28 to 1.49.
_FLANGE_M_PER_JOINT_RAD = 1.30
_LEAST_FRICTION = 0.2  # of what is known: no joint runs without any


def draw_error(
    budget: ErrorBudget, rng: np.random.Generator, flange_m_per_joint_rad: float = _FLANGE_M_PER_JOINT_RAD
) -> RobotError:
    """An actual robot and sensor drawn from a budget; another arm than the cell's own has another lever."""
    direction = rng.normal(size=3)
    near, far = budget.compliance_rad_per_nm
    return RobotError(
        link_m=rng.normal(size=(JOINTS, 3)) * budget.link_m,
        twist_rad=rng.normal(size=(JOINTS, 3)) * budget.twist_rad,
        zero_rad=rng.normal(size=JOINTS) * budget.zero_rad,
        compliance_rad_per_nm=np.array([near] * 3 + [far] * 3),
        repeatability_rad=np.sqrt(3) * budget.repeatability_m / _RP_PER_SIGMA / flange_m_per_joint_rad,
        tip_flange_m=budget.tip_m * direction / np.linalg.norm(direction),
        T_camera_mount=rigid_from(
            Rotation.from_rotvec(rng.normal(size=3) * budget.mount_rad), rng.normal(size=3) * budget.mount_m
        ),
        focal_ratio=float(rng.normal() * budget.focal_ratio),
        principal_px=rng.normal(size=2) * budget.principal_px,
        plane_rad=rng.normal(size=3) * budget.plane_rad,
        plane_m=float(rng.normal() * budget.plane_m),
        friction_ratio=np.maximum(rng.normal(size=JOINTS) * budget.friction_ratio, _LEAST_FRICTION - 1),
    )


def flange_m_per_joint_rad(arm: Axes, joints_rad: Float[np.ndarray, "6"]) -> float:
    """How far the flange moves, root mean square, for equal independent turns of all joints: |J| of its position."""
    kinematics = NumericalInverse(
        axes_base=arm.axes_base, anchors_base=arm.anchors_base, T_base_flange_zero=arm.T_base_flange_zero
    )
    return float(np.linalg.norm(kinematics.jacobian(np.asarray(joints_rad, float)[None])[0, :3]))


def exact_robot() -> RobotError:
    """A robot and sensor as drawn, mount included: what the controller knows."""
    return draw_error(replace(BUDGETS["perfect"], mount_m=0.0, mount_rad=0.0), np.random.default_rng(0))
