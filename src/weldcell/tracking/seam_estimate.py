"""The seam as the sightings so far have it: Bayesian regression on the unknowns of a `SeamModel`, frame by frame.

With residuals e_i at x_i, Jacobians J_i, variances s_i^2 and robust weights w_i (Tukey's biweight on |e| / s), the
posterior under a prior of precision P is normal with

    information  A = P + sum w_i / s_i^2 J_i^T J_i        mean  A^-1 b,   b = sum w_i / s_i^2 J_i^T (e_i + J_i x_i).

*Hypotheses.* Misplacement explains much of what a drift does, and the reverse; so does the shape of a part that is not
quite as drawn. So the prior is a mixture: nothing drifts, one mode alone does, or all do, on a part that is as drawn or
on a bent one; each is a diagonal P. The evidence of each is, up to what they share, |P|^(1/2) |A|^(-1/2)
exp(b^T A^-1 b / 2) (MacKay 1992, Neural Computation 4, 415): where two fit alike, the simpler one weighs more. The
estimate is the mixture's mean and covariance.

The newest points are linearised and weighted anew with every frame. Older ones are settled: their sums are kept, and
made anew only when the misplacement has moved so far that second-order terms would count. The order in which
points arrive changes nothing but which of them are the newest.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from weldcell.tracking.seam_model import Linearised, SeamModel

_FRESH, _SETTLED_AT_ONCE = 96, 32
_TUKEY = 4.685
_FIRST_POINTS, _FIRST_ROUNDS = 24, 3
_MOVED_M = 1e-3  # a bend of 10 / m makes 5 um of it
_MEDIAN_TO_SIGMA = 1.4826
_NOISIEST = 10.0
_NEGLIGIBLE = 0.01
_REVIEW = 8  # points
_NEIGHBOURS = 5
_TREND_M = 5e-3


@dataclass(kw_only=True, eq=False)
class SeamBuffer:
    """The points that were believed, in the order in which they came."""

    points_base: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    arc_s: Float[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0))
    """When each was seen, after the arc was lit."""
    sigma_m: Float[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0))
    """Standard deviation of each as its sighting gave it."""
    arc_length_m: Float[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0))
    """Where each lies on the path by the last linearisation."""
    weight: Float[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0))
    """Robust weight: 0 for a stray."""

    def __len__(self) -> int:
        return len(self.arc_s)

    def add(self, point_base: Float[np.ndarray, "3"], arc_s: float, sigma_m: float, arc_length_m: float) -> None:
        """Takes a point in."""
        self.points_base = np.vstack([self.points_base, point_base])
        self.arc_s = np.append(self.arc_s, arc_s)
        self.sigma_m = np.append(self.sigma_m, sigma_m)
        self.arc_length_m = np.append(self.arc_length_m, arc_length_m)
        self.weight = np.append(self.weight, 1.0)


class SeamEstimate:
    """The posterior of a seam model's unknowns."""

    def __init__(self, model: SeamModel, least_sigma_m: float) -> None:
        self.model = model
        self.buffer = SeamBuffer()
        self.noise = 1.0
        """How many times as large as their sigmas the residuals of the newest points are, at least one."""
        self.weights = np.full(len(model.precisions), 1 / len(model.precisions))
        """How probable each hypothesis is."""
        self._reviewed = 0
        self._least_sigma_m = least_sigma_m
        self._x = np.zeros(model.count)
        self._covariance = np.eye(model.count)
        self._trend = -np.inf, np.zeros(2)
        self._fitted = False
        self._settled = 0
        self._settled_x = self._x
        self._settled_sums = np.zeros((model.count, model.count)), np.zeros(model.count)

    def add(self, point_base: Float[np.ndarray, "3"], arc_s: float, sigma_m: float, near_m: float) -> None:
        """Takes in a point that was believed; `refit` makes it count."""
        self.reach(arc_s)
        self.buffer.add(point_base, arc_s, float(np.hypot(sigma_m, self._least_sigma_m)), near_m)

    def refit(self) -> None:
        """Fits the model to the points in the buffer."""
        for _ in range(_FIRST_ROUNDS if len(self.buffer) <= _FIRST_POINTS else 1):
            if self._moved_m() > _MOVED_M:
                self._settle_again()
            self._round()
        self._fitted = True
        if len(self.buffer) - self._settled >= _FRESH + _SETTLED_AT_ONCE:
            self._settle(self._settled + _SETTLED_AT_ONCE)

    def surprise(
        self, point_base: Float[np.ndarray, "3"], arc_s: float, near_m: float
    ) -> tuple[Float[np.ndarray, "2"], float, float]:
        """How far a point lies from the expected seam (lateral, vertical), its sigma (both m), and its arc length.

        Where the last points lie a little beside the estimate, so may this one.
        """
        self.reach(arc_s)
        at = self.model.seen(self._x, point_base[None], np.array([arc_s]), np.array([near_m]))
        place_m, off_m = float(at.arc_length_m[0]), at.deviations_m[0]
        if abs(place_m - self._trend[0]) < _TREND_M:
            off_m = off_m - self._trend[1]
        return off_m, float(self._sigma_m(at)[0]), place_m

    def curve(
        self, arc_length_m: Float[np.ndarray, "m"], arc_s: Float[np.ndarray, "m"]
    ) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m"]]:
        """Lateral and vertical deviations of the seam at places and times, and the sigma of one of them (m)."""
        self.reach(float(arc_s.max(initial=0.0)))
        at = self.model.crossing(self._x, arc_length_m, arc_s)
        return at.deviations_m, self._sigma_m(at)

    def drift_m(self, arc_s: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 3"]:
        """The estimated drift in the base at these times since the arc was lit."""
        self.reach(float(arc_s.max(initial=0.0)))
        return self.model.drift_m(self._x, arc_s)

    def reach(self, arc_s: float) -> None:
        """Lengthens the drift's model so that it covers this time."""
        self.model = self.model.reaching(arc_s)
        more = self.model.count - len(self._x)
        if more:
            self._x, self._settled_x = np.pad(self._x, (0, more)), np.pad(self._settled_x, (0, more))
            information, vector = self._settled_sums
            self._settled_sums = np.pad(information, (0, more)), np.pad(vector, (0, more))
            grown = np.eye(self.model.count)
            grown[:-more, :-more] = self._covariance
            self._covariance = grown

    def _round(self) -> None:
        """One step of Gauss-Newton, and of the robust weights of the newest points once there is a seam to judge by."""
        fresh = slice(self._settled, len(self.buffer))
        at = self._seen(fresh)
        if self._fitted:
            self._weigh(at, fresh)
        information, vector = self._sums(at, fresh)
        self._judge(information + self._settled_sums[0], vector + self._settled_sums[1])

    def _judge(self, information: Float[np.ndarray, "n n"], vector: Float[np.ndarray, "n"]) -> None:
        """The posterior over the hypotheses, by what the points say; those out of question are asked now and then."""
        known = len(self.buffer) < self._reviewed + _REVIEW
        tried = np.flatnonzero(self.weights) if known else np.arange(len(self.weights))
        self._reviewed = self._reviewed if known else len(self.buffer)
        priors = self.model.precisions[tried]
        factors = np.linalg.cholesky(information + priors[:, None] * np.eye(len(vector)))
        halves = np.array([solve_triangular(factor, vector, lower=True) for factor in factors])
        diagonals = np.diagonal(factors, axis1=1, axis2=2)
        evidence = (np.log(priors) / 2 - np.log(diagonals)).sum(axis=1) + (halves**2).sum(axis=1) / 2
        weights = np.exp(evidence - evidence.max())
        weights[weights < _NEGLIGIBLE] = 0
        weights /= weights.sum()
        self.weights = np.zeros(len(self.weights))
        self.weights[tried] = weights
        held = np.flatnonzero(weights)
        roots = np.sqrt(weights[held])[:, None]
        inverses = [solve_triangular(factors[k], np.eye(len(vector)), lower=True) for k in held]
        means = np.array([inverse.T @ halves[k] for k, inverse in zip(held, inverses, strict=True)])
        self._x = weights[held] @ means
        rows = [root * inverse for root, inverse in zip(roots, inverses, strict=True)]
        spread = np.vstack([*rows, roots * (means - self._x)])
        self._covariance = spread.T @ spread

    def _weigh(self, at: Linearised, fresh: slice) -> None:
        """Weights by how far points lie from their neighbours: what these have in common is no spatter."""
        common = _running_median(at.arc_length_m, at.deviations_m)
        farthest = int(np.argmax(at.arc_length_m))
        self._trend = float(at.arc_length_m[farthest]), common[farthest]
        relative = np.abs(at.deviations_m - common) / self.buffer.sigma_m[fresh, None]
        believed = relative[self.buffer.weight[fresh] > 0]
        if len(believed) > _FIRST_POINTS:
            self.noise = float(np.clip(_MEDIAN_TO_SIGMA * np.median(believed), 1.0, _NOISIEST))
        distance = np.linalg.norm(relative, axis=1) / (self.noise * _TUKEY)
        self.buffer.weight[fresh] = np.maximum(1 - distance * distance, 0) ** 2

    def _settle(self, until: int) -> None:
        old = slice(self._settled, until)
        information, vector = self._sums(self._seen(old), old)
        self._settled_sums = self._settled_sums[0] + information, self._settled_sums[1] + vector
        if self._settled == 0:
            self._settled_x = self._x
        self._settled = until

    def _settle_again(self) -> None:
        until, self._settled = self._settled, 0
        self._settled_sums = np.zeros((self.model.count, self.model.count)), np.zeros(self.model.count)
        self._settle(until)

    def _seen(self, rows: slice) -> Linearised:
        """The points of the buffer against the present model; keeps where they lie."""
        buffer = self.buffer
        at = self.model.seen(self._x, buffer.points_base[rows], buffer.arc_s[rows], buffer.arc_length_m[rows])
        buffer.arc_length_m[rows] = at.arc_length_m
        return at

    def _sums(self, at: Linearised, rows: slice) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n"]]:
        """What points add to the information and to its product with the mean."""
        weight = self.buffer.weight[rows] / (self.noise * self.buffer.sigma_m[rows]) ** 2
        jacobian = at.jacobian_m.reshape(-1, self.model.count)
        target = at.deviations_m.reshape(-1) + jacobian @ self._x
        half = jacobian * np.sqrt(np.repeat(weight, 2))[:, None]
        return half.T @ half, jacobian.T @ (np.repeat(weight, 2) * target)

    def _sigma_m(self, at: Linearised) -> Float[np.ndarray, "m"]:
        """Standard deviation of one coordinate of the modelled seam (root of the mean of both variances)."""
        variances = np.einsum("mkn,mkn->mk", at.jacobian_m @ self._covariance, at.jacobian_m)
        return np.sqrt(np.maximum(variances, 0.0).mean(axis=1))

    def _moved_m(self) -> float:
        """How far the modelled part has moved since the older points were linearised."""
        if not self._settled:
            return 0.0
        return self.model.moved_m(self._x, self._settled_x)


def _running_median(at_m: Float[np.ndarray, "n"], rows: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """The median of each row and its neighbours in place; zero where there are too few to have one."""
    if len(at_m) < _NEIGHBOURS:
        return np.zeros_like(rows)
    order = np.argsort(at_m)
    starts = np.clip(np.arange(len(at_m)) - _NEIGHBOURS // 2, 0, len(at_m) - _NEIGHBOURS)
    medians = np.empty_like(rows)
    medians[order] = np.median(rows[order][starts[:, None] + np.arange(_NEIGHBOURS)], axis=1)
    return medians
