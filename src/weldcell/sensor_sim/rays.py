"""Rays through MuJoCo's scene: what they meet first, by Embree (fast) or by MuJoCo itself (the reference).

Here rays and data are checked, and geoms that no ray can reach are left out (bounding spheres against the cone of
rays); `embree_rays` and `mujoco_rays` do the rest.
"""

import copy
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal, Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.errors import BadGeometry, NotReady
from weldcell.sensor_sim.mujoco_rays import MujocoRays, NearestHits
from weldcell.sensor_sim.solid_rays import Origins

SCENE_GROUPS = (0, 1, 2)
"""Geom groups that light meets: parts, arm, torch; not 3, the sensor's own head."""

Backend = Literal["embree", "mujoco"]

_LEAST_FAN = 1e-3  # rad between the first and the last ray of a fan
_FLAT = 1e-9  # of a direction out of the plane: a nanometre in a metre, as the spheres grow by
_UNIT_TOLERANCE = 1e-9  # far above rounding, far below a nanometre at the sensor's range


@dataclass(frozen=True, kw_only=True)
class RayHits:
    """What each ray meets first."""

    hit: Bool[np.ndarray, "n"]
    """Whether the ray meets anything."""
    distance_m: Float[np.ndarray, "n"]
    """Distance from the origin; NaN for a miss."""
    points: Float[np.ndarray, "n 3"]
    """Where, in the frame of the rays (base); NaN for a miss."""
    normals: Float[np.ndarray, "n 3"]
    """Outward unit normal of the surface there (along the ray if it is met from inside); NaN for a miss."""
    geom_id: Int[np.ndarray, "n"]
    """The geom; -1 for a miss."""
    face_id: Int[np.ndarray, "n"]
    """The triangle of the geom's mesh; -1 for a miss, on solids, and always with MuJoCo's rays."""


@runtime_checkable
class _Tracer(Protocol):
    """What finds the nearest hits on the chosen geoms."""

    def nearest(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Origins,
        directions: Float[np.ndarray, "n 3"],
    ) -> NearestHits: ...

    def maybe_blocked(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
        within_m: Float[np.ndarray, "n"],
    ) -> Bool[np.ndarray, "n"]: ...


class RayCaster:
    """Casts rays against the geoms of a model as it was when the caster was made; one caster for each thread."""

    def __init__(
        self, model: mujoco.MjModel, groups: tuple[int, ...] = SCENE_GROUPS, backend: Backend | None = None
    ) -> None:
        """`backend` is Embree where it is installed, else MuJoCo, unless one is named: both meet the same surfaces."""
        model = copy.copy(model)
        self._tracer = _tracer(backend or ("embree" if find_spec("embreex") else "mujoco"), model)
        painted = model.geom_matid >= 0
        alpha = model.geom_rgba[:, 3].copy()
        alpha[painted] = model.mat_rgba[model.geom_matid[painted], 3]
        self._seen = np.isin(model.geom_group, groups) & (alpha > 0)  # as MuJoCo: what is invisible stops no ray
        unbounded = np.isin(model.geom_type, (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD))
        self._radius_m = np.where(unbounded, np.inf, model.geom_rbound)

    def cast(
        self,
        data: mujoco.MjData,
        origin: Origins,
        directions: Float[np.ndarray, "n 3"],
        among: Bool[np.ndarray, "geoms"] | None = None,
    ) -> RayHits:
        """What rays from `origin` (one, or one for each ray) along unit `directions` (base frame, m) meet first.

        `among` names the geoms that matter, if that is known; else those that no ray can reach are left out here.
        Raises BadGeometry for rays that are not finite or not of unit length, NotReady for data without kinematics.
        """
        origin = np.asarray(origin, dtype=float)
        directions = np.asarray(directions, dtype=float)
        _check_rays(origin, directions)
        self._check_data(data)
        if len(directions) == 0:
            nothing = np.empty(0, np.int32)
            return _hits(origin, directions, NearestHits(np.empty(0), np.empty((0, 3)), nothing, nothing))
        chosen = self._seen & (self.reachable(data, origin, directions) if among is None else among)
        return _hits(origin, directions, self._tracer.nearest(data, chosen, origin, directions))

    def blocked(
        self,
        data: mujoco.MjData,
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
        within_m: Float[np.ndarray, "n"],
        *,
        among: Bool[np.ndarray, "geoms"] | None = None,
        exact: bool = True,
    ) -> Bool[np.ndarray, "n"]:
        """Whether anything stops rays from `origin` along unit `directions` (base frame) before these distances (m).

        Exact as `cast`, but faster where most rays get through; if not `exact`, single precision decides (a micrometre)
        and it is faster everywhere. `among` names the geoms that may stop them. Raises as `cast` does.
        """
        origin, directions = np.asarray(origin, dtype=float), np.asarray(directions, dtype=float)
        _check_rays(origin, directions)
        self._check_data(data)
        if len(directions) == 0:
            return np.zeros(0, dtype=bool)
        chosen = self._seen & self.reachable(data, origin, directions)
        if among is not None:
            chosen &= among
        blocked = self._tracer.maybe_blocked(data, chosen, origin, directions, within_m)
        if not (exact or blocked.all()):  # a tracer that can't tell says that all may be blocked
            return blocked
        doubtful = np.flatnonzero(blocked)
        if len(doubtful) > 0:
            first = self.cast(data, origin, directions[doubtful], among=chosen)
            blocked[doubtful] = first.hit & (first.distance_m <= within_m[doubtful])
        return blocked

    def reachable(
        self, data: mujoco.MjData, origin: Origins, directions: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, "geoms"]:
        """Whether a geom's bounding sphere touches the cone that holds all rays, and their plane if they lie in one.

        Rays from within a ball about their mean origin are led from its centre: each geom grows by the ball's radius.
        """
        origin, spread_m = _ball(origin)
        axis = directions.sum(axis=0)
        axis = axis / max(float(np.linalg.norm(axis)), 1e-300)  # rays that cancel out give a cone of everything
        cone_rad = np.arccos(np.clip((directions @ axis).min(), -1, 1)) + 1e-6
        offset = data.geom_xpos - origin
        range_m = np.linalg.norm(offset, axis=1)
        radius_m = self._radius_m * (1 + 1e-6) + 1e-9 + spread_m
        with np.errstate(divide="ignore", invalid="ignore"):
            off_axis_rad = np.arccos(np.clip(offset @ axis / range_m, -1, 1))
            apparent_rad = np.arcsin(np.clip(radius_m / range_m, 0, 1))
        inside = ~(range_m > radius_m)
        return (inside | (off_axis_rad <= cone_rad + apparent_rad)) & ~(_off_plane_m(offset, directions) > radius_m)

    def _check_data(self, data: mujoco.MjData) -> None:
        count = len(self._seen)
        if data.geom_xpos.shape[0] != count:
            raise NotReady(f"rays: the data hold {data.geom_xpos.shape[0]} geoms, expected {count} (another model?)")
        rotations = data.geom_xmat.reshape(-1, 9)
        if not np.all(np.abs(np.einsum("ni,ni->n", rotations, rotations) - 3.0) < 1e-5):
            raise NotReady("rays: the scene's geoms have no poses yet; call mj_kinematics or mj_forward first")


def _off_plane_m(
    offset: Float[np.ndarray, "geoms 3"], directions: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "geoms"]:
    """Distances of places (from the rays' origin) from the plane that the rays span; 0 if they span space."""
    normal = np.cross(directions[0], directions[-1])
    length = float(np.linalg.norm(normal))
    if length < _LEAST_FAN or np.abs(directions @ normal).max() > _FLAT * length:
        return np.zeros(len(offset))
    return np.abs(offset @ normal) / length


def _tracer(backend: Backend, model: mujoco.MjModel) -> _Tracer:
    if backend == "mujoco":
        return MujocoRays(model)
    if backend != "embree":
        raise BadGeometry(f"rays: unknown backend {backend!r}. Available: embree, mujoco")
    try:
        from weldcell.sensor_sim.embree_rays import EmbreeRays  # not at the top: there is no wheel for 64-bit ARM
    except ImportError as error:
        raise NotReady(f"rays: Embree is not available ({error}); pip install embreex, or use MuJoCo's rays") from error
    return EmbreeRays(model)


def _ball(origin: Origins) -> tuple[Float[np.ndarray, "3"], float]:
    """Centre and radius of a ball that holds all origins."""
    if origin.ndim == 1:
        return origin, 0.0
    centre = origin.mean(axis=0)
    return centre, float(np.linalg.norm(origin - centre, axis=1).max())


def _check_rays(origin: Origins, directions: Float[np.ndarray, "n 3"]) -> None:
    """Refuse what would end the process (a zero direction) or silently miss (NaN)."""
    if directions.ndim != 2 or directions.shape[1] != 3 or origin.shape not in ((3,), directions.shape):
        raise BadGeometry(
            f"rays: expected an origin (3,) or (n, 3) and directions (n, 3), found {origin.shape}, {directions.shape}"
        )
    if not np.all(np.isfinite(origin)):
        worst = origin if origin.ndim == 1 else origin[~np.isfinite(origin).all(axis=1)][0]
        raise BadGeometry(f"rays: expected a finite origin, found {worst.tolist()}")
    if not np.all(np.isfinite(directions)):
        raise BadGeometry("rays: expected finite directions, found NaN or infinity")
    length = np.sqrt(np.einsum("ni,ni->n", directions, directions))
    if np.any(np.abs(length - 1) > _UNIT_TOLERANCE):
        worst = length[np.argmax(np.abs(length - 1))]
        raise BadGeometry(f"rays: expected directions of unit length, found length {worst:.6g}")


def _hits(
    origin: Origins,
    directions: Float[np.ndarray, "n 3"],
    nearest: NearestHits,
) -> RayHits:
    hit = nearest.geom_id >= 0
    distance_m = np.where(hit, nearest.distance_m, np.nan)
    return RayHits(
        hit=hit,
        distance_m=distance_m,
        points=origin + distance_m[:, None] * directions,
        normals=np.where(hit[:, None], nearest.normals, np.nan),
        geom_id=nearest.geom_id,
        face_id=np.where(hit, nearest.face_id, -1),
    )
