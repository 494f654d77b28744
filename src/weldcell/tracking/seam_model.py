r"""Where the seam lies, as a function of unknowns that are all standard normal numbers before anything is seen.

The part stands a little off, its seam is not quite the drawn one, and it drifts while it is welded. At arc length s of
the taught path p(s), with left l(s) and up u(s), t seconds after the arc was lit, the seam is at

    C(s, t) = c + R (p(s) + a(s) l(s) + b(s) u(s) - c) + m + d(t)

with R a small rotation about the path's middle c, m a translation (together the misplacement), a and b the residual
shape (two stationary processes of Matern 5/2 covariance, projected on even knots), and d(t) the drift (`DriftBasis`,
one for each axis of the base). All these are linear in whitened unknowns x ~ N(0, I), except R = exp(rotation vector).

*Seen.* A point q seen at time t goes back to the taught part, q' = c + R^T (q - c - m - d(t)); its foot on the path is
at s, its deviations are l.q' and u.q' against p(s), and the residuals e = (lateral - a(s), vertical - b(s)) are those
in the light plane up to the cosine of a few degrees. Where along the seam the light fell does not matter: a point
anywhere on the seam has e = 0. A change of x moves the model by J dx, J's rows being (R l) and (R u) times

    dm,  dw x (q - c - m - d),  dd(t),  and da(s), db(s) themselves,

so e(x + dx) = e(x) - J dx up to second order: Gauss-Newton, linearised anew while x moves.

*Asked.* The seam's deviations at s are those of the point where C(., t) crosses the plane square to the path at s.
That point is C(s', t), with s' by Newton's method. Its change within the plane is J dx less what sliding along the
seam's tangent g takes back: dC - g (t.dC) / (t.g).

*What can be told.* While the light runs a look-ahead L before the torch at speed v, s = L + v t holds throughout the
weld: along a straight seam a slope of lateral k means the same as a drift of k v. What tells them apart is the run-in,
where the light travels the first L and no arc burns: N frames of noise sigma determine the slope to
sigma sqrt(12 / N) / L, and the drift within one look-ahead to that times L. A bend of the part's own over more than L
cannot be told from a drift by any tracker; there the two priors decide. On a path that bends, a shift of the part along
itself and its tilts show in the run-in too little to be told from a drift later; and what drifts along the seam where
the light is goes across it where the torch is, on another heading: only the past tells of it (`drift`). Once the light
is past the end, the drift is foreseen. Without a model of it the torch goes where the seam was L / v seconds ago: it
errs by (drift's rate) L / v.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.spatial.transform import Rotation

from weldcell.tracking.drift import DriftBasis
from weldcell.tracking.taught_path import TaughtPath

_FOOT_STEPS = 2  # from where the foot was before the last small correction
_CROSSING_STEPS = 2
_RIGID = 6
_ROOT_5 = 5**0.5


@dataclass(frozen=True, kw_only=True)
class SeamPriors:
    """How far a seam may lie from the taught path before it is seen: standard deviations."""

    place_m: float = 10e-3
    """Misplacement of the part along each axis."""
    yaw_rad: float = np.deg2rad(3.0)
    """Its turn about the base's z."""
    tilt_rad: float = np.deg2rad(0.2)
    """Its turns about the base's x and y: parts lie on tables."""
    shape_m: float = 0.03e-3
    """Residual shape; the default is what a calibrated arm leaves."""
    bent_shape_m: float = 0.3e-3
    """The same for a part that is not as drawn: bent, or drawn by tacks."""
    shape_length_m: float = 40e-3
    """Length over which the shape stays alike."""
    drift_m: float = 0.8e-3
    """Each mode of the thermal drift along each axis; 0 for a model without drift."""
    drift_shortest_s: float = 5.0
    """Time constant of the quickest mode."""
    drift_wander_m_s: float = 0.015e-3
    """Rate of what the modes leave."""
    drift_memory_s: float = 20.0
    """Time over which that rate stays alike."""
    drift_knot_s: float = 6.0
    """Time between the wandering's knots."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearised:
    """Deviations at m places and how they change with the unknowns."""

    arc_length_m: Float[np.ndarray, "m"]
    """Where on the taught path."""
    deviations_m: Float[np.ndarray, "m 2"]
    """Lateral and vertical."""
    jacobian_m: Float[np.ndarray, "m 2 n"]
    """Change of the modelled deviations with each unknown."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamModel:
    """The seam as a function of whitened unknowns: misplacement (6), shape (two rows), drift (triples)."""

    taught: TaughtPath
    priors: SeamPriors
    drift: DriftBasis | None
    """None where nothing drifts."""
    shape: "ShapeBasis"

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return self._drift_starts + (3 * self.drift.count if self.drift else 0)

    def reaching(self, arc_s: float) -> "SeamModel":
        """This model, or one with more unknowns behind the present ones, whose drift reaches this time."""
        drift = self.drift.reaching(arc_s) if self.drift else None
        return self if drift is self.drift else replace(self, drift=drift)

    @cached_property
    def precisions(self) -> Float[np.ndarray, "h n"]:
        """For each hypothesis, on the drift and on the shape, the prior precision of each unknown."""
        drift = np.repeat(self.drift.precisions(), 3, axis=1) if self.drift else np.ones((1, 0))
        drawn = np.hstack([np.ones((len(drift), self._drift_starts)), drift])
        bent = drawn.copy()
        bent[:, _RIGID : self._drift_starts] = (self.priors.shape_m / self.priors.bent_shape_m) ** 2
        return np.vstack([drawn, bent])

    def seen(
        self,
        x: Float[np.ndarray, "n"],
        points_base: Float[np.ndarray, "m 3"],
        arc_s: Float[np.ndarray, "m"],
        near_m: Float[np.ndarray, "m"],
    ) -> Linearised:
        """How far points lie from the modelled seam; `near_m` are arc lengths not far from their feet."""
        rotation, translation = self._rigid(x)
        basis = self._drift_at(arc_s)
        levers = points_base - self._middle - translation - self._drift(x, basis)
        points_part = self._middle + levers @ rotation
        arc_length_m, at = self.taught.foot(points_part, near_m, _FOOT_STEPS)
        across = np.stack([at.lefts, at.ups], axis=1)
        shape = self.shape.at(arc_length_m)
        deviations = (across @ (points_part - at.points)[..., None])[..., 0] - self._shape(x, shape)
        across = across @ rotation.T
        jacobian = self._jacobian(across, levers, basis, shape, across)
        return Linearised(arc_length_m=arc_length_m, deviations_m=deviations, jacobian_m=jacobian)

    def crossing(
        self, x: Float[np.ndarray, "n"], arc_length_m: Float[np.ndarray, "m"], arc_s: Float[np.ndarray, "m"]
    ) -> Linearised:
        """The modelled seam's deviations in the planes square to the taught path at these arc lengths."""
        rotation, translation = self._rigid(x)
        basis = self._drift_at(arc_s)
        moved = self._middle + translation + self._drift(x, basis)
        here = self.taught.places(arc_length_m)
        at, place_m = here, arc_length_m
        for step in range(_CROSSING_STEPS + 1):
            shape = self.shape.at(place_m)
            sideways = self._shape(x, shape)
            levers = (at.points + sideways[:, :1] * at.lefts + sideways[:, 1:] * at.ups - self._middle) @ rotation.T
            tangents, off = at.steps @ rotation.T, levers + moved - here.points
            slope = np.einsum("mc,mc->m", here.steps, tangents)
            if step < _CROSSING_STEPS:
                place_m = place_m - np.einsum("mc,mc->m", here.steps, off) / slope
                at = self.taught.places(place_m)
        across = np.stack([here.lefts, here.ups], axis=1)
        slides = (across @ tangents[..., None]) / slope[:, None, None]
        directions = across - slides * here.steps[:, None]
        jacobian = self._jacobian(directions, levers, basis, shape, np.stack([at.lefts, at.ups], axis=1) @ rotation.T)
        return Linearised(
            arc_length_m=arc_length_m, deviations_m=(across @ off[..., None])[..., 0], jacobian_m=jacobian
        )

    def drift_m(self, x: Float[np.ndarray, "n"], arc_s: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 3"]:
        """The drift in the base at these times since the arc was lit."""
        return self._drift(x, self._drift_at(arc_s))

    def moved_m(self, x: Float[np.ndarray, "n"], other: Float[np.ndarray, "n"]) -> float:
        """A bound on how far the part's places lie apart by two values of the unknowns, their misplacements only."""
        step = (x - other)[:_RIGID] * self._sigmas
        return float(np.linalg.norm(step[:3]) + np.linalg.norm(step[3:]) * self._reach_m)

    def _jacobian(
        self,
        directions: Float[np.ndarray, "m 2 3"],
        levers: Float[np.ndarray, "m 3"],
        basis: Float[np.ndarray, "m k"],
        shape: Float[np.ndarray, "m j"],
        across: Float[np.ndarray, "m 2 3"],
    ) -> Float[np.ndarray, "m 2 n"]:
        """How the modelled point moves along two directions with each unknown; `across` are its left and up."""
        rows, knots = len(levers), self.shape.count
        jacobian = np.empty((rows, 2, self.count))
        jacobian[..., :3] = directions * self._sigmas[:3]
        jacobian[..., 3:6] = _cross(levers[:, None], directions) * self._sigmas[3:]
        shares = directions @ across.swapaxes(1, 2)
        jacobian[..., _RIGID : _RIGID + knots] = shares[..., :1] * shape[:, None]
        jacobian[..., _RIGID + knots : self._drift_starts] = shares[..., 1:] * shape[:, None]
        drifts = basis[:, None, :, None] * directions[:, :, None, :]
        jacobian[..., self._drift_starts :] = drifts.reshape(rows, 2, -1)
        return jacobian

    def _rigid(self, x: Float[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        """The part's turn about the path's middle, and its shift."""
        return Rotation.from_rotvec(x[3:6] * self._sigmas[3:]).as_matrix(), x[:3] * self._sigmas[:3]

    def _shape(self, x: Float[np.ndarray, "n"], shape: Float[np.ndarray, "m j"]) -> Float[np.ndarray, "m 2"]:
        return shape @ x[_RIGID : self._drift_starts].reshape(2, -1).T

    def _drift_at(self, arc_s: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m k"]:
        return self.drift.at(arc_s) if self.drift else np.zeros((len(arc_s), 0))

    def _drift(self, x: Float[np.ndarray, "n"], basis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m 3"]:
        return basis @ x[self._drift_starts : self.count].reshape(-1, 3)

    @cached_property
    def _drift_starts(self) -> int:
        return _RIGID + 2 * self.shape.count

    @cached_property
    def _sigmas(self) -> Float[np.ndarray, "6"]:
        priors = self.priors
        return np.array([*[priors.place_m] * 3, priors.tilt_rad, priors.tilt_rad, priors.yaw_rad])

    @cached_property
    def _middle(self) -> Float[np.ndarray, "3"]:
        return np.asarray(self.taught.points_base.mean(axis=0))

    @cached_property
    def _reach_m(self) -> float:
        return float(np.linalg.norm(self.taught.points_base - self._middle, axis=1).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeBasis:
    """A stationary random shape along a path as a linear function of standard normal numbers, one for each knot."""

    knots_m: Float[np.ndarray, "j"]
    """Arc lengths."""
    sigma_m: float
    """Prior standard deviation of the shape."""
    length_m: float
    """Length over which it stays alike, in the covariance of Matern, 5/2."""

    @property
    def count(self) -> int:
        """Number of knots."""
        return len(self.knots_m)

    def at(self, arc_length_m: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m j"]:
        """What each number adds to the shape at these arc lengths (m)."""
        return self._covariance(arc_length_m) @ self._whitening

    def _covariance(self, arc_length_m: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m j"]:
        """Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, equation 4.17."""
        reach = np.abs(arc_length_m[:, None] - self.knots_m) * (_ROOT_5 / self.length_m)
        return self.sigma_m**2 * (1 + reach + reach * reach / 3) * np.exp(-reach)

    @cached_property
    def _whitening(self) -> Float[np.ndarray, "j j"]:
        factor = np.linalg.cholesky(self._covariance(self.knots_m))
        return np.asarray(solve_triangular(factor, np.eye(self.count), lower=True).T)


def seam_model(taught: TaughtPath, priors: SeamPriors) -> SeamModel:
    """The model of a seam near this path."""
    spacing_m = priors.shape_length_m / 2
    knots = int(np.ceil((taught.end_m - taught.start_m) / spacing_m)) + 3  # one beyond each end
    middle_m = (taught.start_m + taught.end_m) / 2
    drift = DriftBasis(
        size_m=priors.drift_m,
        shortest_s=priors.drift_shortest_s,
        wander_m_s=priors.drift_wander_m_s,
        memory_s=priors.drift_memory_s,
        knot_s=priors.drift_knot_s,
    )
    return SeamModel(
        taught=taught,
        priors=priors,
        drift=drift if priors.drift_m else None,
        shape=ShapeBasis(
            knots_m=middle_m + spacing_m * (np.arange(knots) - (knots - 1) / 2),
            sigma_m=priors.shape_m,
            length_m=priors.shape_length_m,
        ),
    )


def _cross(a: Float[np.ndarray, "*m 3"], b: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*k 3"]:
    """The vector product; several times as fast as numpy's on few rows."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
