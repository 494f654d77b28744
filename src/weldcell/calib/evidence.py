"""How large the arm's errors and the noise are, told by the data themselves (empirical Bayes).

With the residuals linear in the unknowns and all normal, the likelihood of the data with the unknowns
integrated out is in closed form (MacKay 1992, Bayesian interpolation; with next to nothing believed about
camera and targets it is Patterson and Thompson's restricted likelihood, 1971):
    -2 log L(sizes) = log|N| + log|J'J| + min |r + J x|^2
N the noise and the priors, J and r the rows of both, whitened. Its maximum makes errors neither larger nor
smaller than what the data show: of a perfect arm next to nothing is estimated, and noise is not taken for
links. A wide belief about each size keeps those in place that the data say nothing about.

With J = Q T (orthonormal Q) and b = r - Q Q'r what remains, the derivative by anything that the noise N_i
of one observation depends on is the trace of L^-1 dN_i L^-T (1 - Q_i Q_i' - b_i b_i'), N_i = L L'.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from weldcell.calib.arm_model import ArmSlices
from weldcell.calib.joint_fit import Weights, whitened, whitening
from weldcell.calib.joint_problem import JointProblem, Sizes
from weldcell.calib.joint_rows import JointModel, JointState

_BELIEF = 2.0  # one sigma of each size's logarithm: a factor of seven
_RANGE = (-9.0, 3.0)  # of the logarithms, against the sizes believed
_NOISES = ("joint_noise_rad", "sight_noise_m")


def adapted_sizes(problem: JointProblem, model: JointModel, state: JointState, sizes: Sizes, weights: Weights) -> Sizes:
    """The sizes that make the data most likely, about a guess of the unknowns; `sizes` is where to start."""
    evidence = Evidence(problem, model, state, weights)
    start = np.log([getattr(sizes, name) for name in evidence.names] / evidence.believed)
    found = minimize(evidence.unlikely, start, jac=True, method="L-BFGS-B", bounds=[_RANGE] * len(start))
    return evidence.sizes(found.x)


class Evidence:
    """How likely the data are as a function of the sizes' logarithms against the believed ones."""

    def __init__(self, problem: JointProblem, model: JointModel, state: JointState, weights: Weights) -> None:
        self._problem, self._model, self._state, self._weights = problem, model, state, weights
        self._seen = model.observations(state)
        columns, arm = model.columns, ArmSlices.of(problem.arm.joints)
        places = {
            "offset_m": arm.offsets,
            "twist_rad": arm.twists,
            "zero_rad": arm.zeros,
            "compliance_rad_per_nm": arm.compliances,
        }
        members = {
            name: np.arange(columns.arm.start + p.start, columns.arm.start + p.stop) for name, p in places.items()
        }
        members["sensor_ratio"] = np.arange(columns.sensor.start, columns.sensor.stop)
        self._members = {name: rows for name, rows in members.items() if columns.free[rows].all()}
        self.names = (*_NOISES, *self._members)
        self.believed = np.array([getattr(problem.sizes, name) for name in self.names])

    def sizes(self, logs: Float[np.ndarray, "s"]) -> Sizes:
        """The sizes with these logarithms against the believed ones."""
        values = self.believed * np.exp(logs)
        return replace(self._problem.sizes, **dict(zip(self.names, values.tolist(), strict=True)))

    def unlikely(self, logs: Float[np.ndarray, "s"]) -> tuple[float, Float[np.ndarray, "s"]]:
        """Minus the logarithm of the likelihood (less a constant) with the beliefs on sizes, and its derivatives."""
        sizes = self.sizes(logs)
        prior_sigma = self._model.columns.prior_sigma(self._problem, sizes)
        factors = whitening(self._seen, sizes)
        rows = whitened(self._model, self._state, self._seen, factors, prior_sigma, self._weights)
        scale = np.linalg.norm(rows.jacobian, axis=0)
        directions, triangle = np.linalg.qr(rows.jacobian / scale)
        remains = rows.residuals - directions @ (directions.T @ rows.residuals)
        log_information = 2 * float(np.log(np.abs(np.diag(triangle)) * scale).sum())
        log_noise = self._log_noise(factors, prior_sigma)
        value = 0.5 * (log_noise + log_information + float(remains @ remains + np.sum((logs / _BELIEF) ** 2)))
        # explained: Q Q' + b b' of each row, or block of rows
        explained = np.column_stack([directions, remains])
        slopes = self._noise_slopes(factors, explained, sizes) + self._prior_slopes(explained)
        return value, np.array(slopes) + logs / _BELIEF**2

    def _log_noise(self, factors: list[Float[np.ndarray, "_ _ _"]], prior_sigma: Float[np.ndarray, "p"]) -> float:
        """Logarithm of the determinant of noise and priors."""
        total = 2 * float(np.log(prior_sigma[self._model.columns.free]).sum())
        for factor, weight in zip(factors, self._weights, strict=True):
            total -= 2 * float(np.log(np.diagonal(factor, axis1=1, axis2=2)[weight > 0]).sum())
        return total

    def _noise_slopes(
        self, factors: list[Float[np.ndarray, "_ _ _"]], explained: Float[np.ndarray, "rows q"], sizes: Sizes
    ) -> list[float]:
        """Derivatives by the logarithms of joint noise and sight noise."""
        by_joints, by_sights, first = 0.0, 0.0, 0
        for each, factor, weight in zip(self._seen, factors, self._weights, strict=True):
            count, components = each.residuals.shape
            block = explained[first : first + count * components].reshape(count, components, -1)
            first += count * components
            left = weight[:, None, None] * (np.eye(components) - block @ block.swapaxes(1, 2))
            spread = factor @ each.by_readings
            by_joints += sizes.joint_noise_rad**2 * float(np.sum((left @ spread) * spread))
            if each.sighted:
                by_sights += sizes.sight_noise_m**2 * float(np.sum((left @ factor) * factor))
        return [by_joints, by_sights]

    def _prior_slopes(self, explained: Float[np.ndarray, "rows q"]) -> list[float]:
        """Derivatives by the logarithms of the errors' sizes."""
        believed = np.flatnonzero(self._model.columns.free)
        left = 1 - np.sum(explained[-len(believed) :] ** 2, axis=1)
        return [float(left[np.isin(believed, members)].sum()) for members in self._members.values()]
