"""Where the points of a curve stop, to a fraction of a column.

Every column near the end is on the curve or off it: seen elsewhere, or missing. What an edge leaves of the stripe's
light in a column t columns inside of it is, behind a lens and pixels that blur by b columns,

    c(t) = Phi(t / b),

a half at the edge itself, so that the stripe is seen a column or two beyond. Speckle multiplies the light by a factor
whose logarithm is about normal, with a deviation s that the curve's own columns tell. With r the light of a column over
the curve's usual one, relative to what it would be beyond the end (on the curve by chance with the probability q), a
column is

    seen on the curve     (p N(ln r; ln c, s^2) / N(ln r; 0, w^2) + q) / q    likelier,
    off it                F + (1 - F) o,   F = Phi((ln r' - ln c) / s),

for in the second case the curve's light was below r', that of what is seen instead or the least that is seen at all,
or else the column is a stray, o times as likely as beyond the end. Strays come in runs, so p and o depend on whether
the column before is on the curve; both are counted on the curve's inner half, for strays and for missing columns. The
product over all columns is the likelihood of an end; its mean and variance are the end and its variance: strays beside
the end make it less certain. Where nobody measured the light, the end lies anywhere between two columns (b = 0).
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr

from weldcell.tracking.curves import LEAST_SCALE, Curve
from weldcell.tracking.quantiles import median, quantile
from weldcell.tracking.section import Corner, Section

PLATE_LOST_SHARE = 0.08
"""Of a plate's ends: none in a hundred in calm pictures, one in ten beside an arc, where plates are bright too."""
_ON_SIGMAS = 3.5
_BEYOND_ON = 0.03  # share of columns beyond a curve's end that lie on it by chance
_PRIOR_BEGINS, _PRIOR_COUNT = 0.1, 4.0  # runs of strays, and columns, counted before any are seen
_PRIOR_GOES_ON = 0.6  # of two columns
_MOST_MISSING = 400
_LEAST_LEAN = 0.05  # of a column out of the curve
_BLUR_COLUMNS = 0.7  # diffraction at f/8, a pixel's box (0.29) and a little defocus: 0.6 to 0.8 at all presets
_REACH_COLUMNS = 3  # of the blur's fade
_STEPS = 4  # of the end's places, a column
_FEWEST_LIT = 6
_DARK_QUANTILE = 0.16  # one sigma below the median: speckle's darker side is the longer one
_LIGHT_SIGMAS = (0.1, 1.0)
_ALIKE = 2.0  # columns that one speckle grain lights: so many say as much as one
_WIDE = 2.0  # spread of chance light over that of the curve's own
_FAINTEST = 1e-7
_NEGLIGIBLE_NATS = 25.0  # an end so much less likely than the likeliest is none
_MOST_LOST = 7.0  # columns: a dark one, and the few behind it that do not count as a piece of stripe
_IN_FRONT_M = 1e-3
_LOST_AT_EDGE, _MIXED_COLUMNS = 0.2, 1.0  # columns this near hold two stripes or light on the face, and may be lost


@dataclass(frozen=True, kw_only=True)
class End:
    """Where the points of a curve stop."""

    corner: Corner
    """The end, on the curve."""
    nats: float
    """How much likelier the points beyond it are, as no part of the curve, than as strays of it (natural logarithm)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Columns:
    """All columns from within the curve to beyond its end, missing ones included."""

    number: Int[np.ndarray, "n"]
    """Of each point's column."""
    on: Bool[np.ndarray, "m"]
    """For each column whether it holds a point of the curve."""
    inside: Float[np.ndarray, "m"]
    """How much likelier what it holds is inside the curve than beyond it, if light says nothing."""
    log_light: Float[np.ndarray, "m"]
    """Of what is seen there, over the curve's usual light; NaN throughout where nobody measured it."""
    log_light_sigma: float

    def between(self, first: int, last: int) -> "_Columns":
        """The columns from one on and before another."""
        here = slice(first, last)
        return replace(self, on=self.on[here], inside=self.inside[here], log_light=self.log_light[here])


def curve_end(
    section: Section,
    curve: Curve,
    inner_m: float,
    outer_m: float,
    *,
    beyond: Curve | None = None,
    lost_share: float = 0.0,
) -> End | None:
    """The end of a curve that holds at x = `inner_m` and no more at `outer_m`; None if there are no points to tell.

    Points on the curve `beyond` the end, if it is known, are no strays. With the probability `lost_share` the stripe's
    last columns were lost, up to seven, if nothing else is seen there.
    """
    away_m = curve.z_of(section.x_m) - section.z_m
    at = _where_columns_cut(section, curve, away_m, (inner_m + outer_m) / 2)
    within = np.flatnonzero((at >= min(inner_m, outer_m)) & (at <= max(inner_m, outer_m)))
    if len(within) < 3:
        return None
    sign = 1.0 if outer_m > inner_m else -1.0
    within = within[np.argsort(sign * at[within])]
    x, part = at[within], section.only(within)
    on = _is_on(part, curve, away_m[within])
    if not on.any():
        return None
    beyond_it = None if beyond is None else ~on & _is_on(part, beyond, beyond.z_of(part.x_m) - part.z_m)
    steps_m = sign * (x[1:] - x[:-1])
    spacing_m = max(median(steps_m), 1e-9)
    missing = np.rint(np.append(steps_m, abs(outer_m - x[-1])) / spacing_m).astype(int) - 1
    columns = _columns(on, beyond_it, np.minimum(np.maximum(missing, 0), _MOST_MISSING), part.amplitude_grey)
    ends, nats, nats_without = _nats_of_ends(columns)
    most = float(nats.max())
    likelihood = np.exp(nats - most)
    likelihood /= likelihood.sum()
    outside = columns.number[-1] + 1
    ends_m = np.interp(
        ends,
        np.concatenate([[-1], columns.number, [outside]]),
        np.concatenate([[x[0] - sign * spacing_m], x, [x[-1] + sign * spacing_m]]),
    )
    x_m = float(likelihood @ ends_m)
    variance = float(likelihood @ np.square(ends_m - x_m))
    if lost_share > 0:
        in_front = part.z_m < curve.z_of(x) - _IN_FRONT_M
        lost_m = sign * spacing_m * min(_dark_columns(columns, ends[int(likelihood.argmax())], in_front), _MOST_LOST)
        x_m += lost_share * lost_m / 2
        variance += lost_share * (1 / 3 - lost_share / 4) * lost_m**2
    sigma_m = math.sqrt((1 + curve.slope_at(x_m) ** 2) * variance + curve.variance_at(x_m))
    return End(corner=Corner(x_m=x_m, z_m=curve.z_at(x_m), sigma_m=sigma_m), nats=most - nats_without)


def _dark_columns(columns: _Columns, end: float, in_front: Bool[np.ndarray, "n"]) -> float:
    """How many columns beyond an end hold nothing at all, or what is in front of the curve: nothing real is."""
    after = columns.number[(columns.number > end) & ~columns.on[columns.number] & ~in_front]
    return float(max((after[0] if len(after) else len(columns.on)) - 0.5 - end, 0.0))


def _where_columns_cut(
    section: Section, curve: Curve, away_m: Float[np.ndarray, "n"], near_m: float
) -> Float[np.ndarray, "n"]:
    """x at which each point's column cuts the curve, so that a stray takes the place of the point that it replaced."""
    lean = 1 - curve.slope_at(near_m) * section.noise_slope
    lean[np.abs(lean) <= _LEAST_LEAN] = 1.0
    return section.x_m + section.noise_slope * away_m / lean


def _is_on(section: Section, curve: Curve, away_m: Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    lean = np.maximum(np.abs(1 - curve.slope_at(float(section.x_m.mean())) * section.noise_slope), _LEAST_LEAN)
    allowed_m = _ON_SIGMAS * max(curve.sigmas, LEAST_SCALE) * section.sigma_m * lean
    return np.asarray(np.abs(away_m) <= np.maximum(allowed_m, 1e-7))


def _columns(
    on: Bool[np.ndarray, "n"],
    beyond_it: Bool[np.ndarray, "n"] | None,
    missing: Int[np.ndarray, "n"],
    amplitude_grey: Float[np.ndarray, "n"],
) -> _Columns:
    """The columns of points in order, and of those `missing` after each of them."""
    number = np.zeros(len(on), int)
    np.cumsum(1 + missing[:-1], out=number[1:])
    count = int(number[-1] + 1 + missing[-1])
    at_point, first_missing, next_missing = _inside_ratios(on, missing)
    if beyond_it is not None:
        at_point[beyond_it] = _BEYOND_ON
    inside = np.full(count, next_missing)
    inside[number[missing > 0] + 1] = first_missing
    inside[number] = at_point
    every_on = np.zeros(count, bool)
    every_on[number] = on
    usual, sigma = _usual_light(on, amplitude_grey)
    least_grey = max(float(amplitude_grey[on].min()), 1e-3)
    log_light = np.full(count, math.log(least_grey) - usual)
    log_light[number] = np.log(np.maximum(amplitude_grey, least_grey)) - usual
    return _Columns(number=number, on=every_on, inside=inside, log_light=log_light, log_light_sigma=sigma)


def _usual_light(on: Bool[np.ndarray, "n"], amplitude_grey: Float[np.ndarray, "n"]) -> tuple[float, float]:
    """Logarithm of the curve's light in its inner half, and what its speckle lets one column say of it (sigma)."""
    half = max(len(on) // 2, 1)
    lit = amplitude_grey[:half][on[:half]]
    if len(lit) < _FEWEST_LIT or not np.isfinite(amplitude_grey).all():
        return math.nan, 1.0
    dark, usual = (math.log(max(grey, 1e-3)) for grey in (quantile(lit, _DARK_QUANTILE), median(lit)))
    return usual, math.sqrt(_ALIKE) * min(max(usual - dark, _LIGHT_SIGMAS[0]), _LIGHT_SIGMAS[1])


def _inside_ratios(
    on: Bool[np.ndarray, "n"], missing: Int[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n"], float, float]:
    """How much likelier each point's column is on the curve than beyond its end; first and later missing columns."""
    off, gap_after = ~on, missing > 0
    before = np.zeros(len(on), int)  # what the column before holds: a point on the curve, none, or a stray
    before[1:] = np.where(gap_after[:-1], 1, 2 * off[:-1])
    half = max(len(on) // 2, 1)
    strays, holes, absent = (
        int(np.count_nonzero(off[:half])),
        int(np.count_nonzero(gap_after[:half])),
        int(missing[:half].sum()),
    )
    runs = strays - int(np.count_nonzero(off[:half] & (before[:half] > 0)))
    stray = min((runs + _PRIOR_BEGINS) / (half - strays + _PRIOR_COUNT), 0.4)
    hole = min((holes + _PRIOR_BEGINS) / (half + _PRIOR_COUNT), 0.4)
    stray_on = min((strays - runs + _PRIOR_GOES_ON) / (strays + 2), 0.9)
    hole_on = min((absent - holes + _PRIOR_GOES_ON) / (absent + 2), 0.9)
    off_beyond = 1 - _BEYOND_ON  # seen elsewhere, or missing, and then the next one mostly too
    of_stray = (2 * stray / off_beyond, 2 * stray_on / off_beyond, stray_on / off_beyond)
    of_on = ((1 - stray - hole) / _BEYOND_ON, (1 - stray_on) / _BEYOND_ON, (1 - stray_on) / _BEYOND_ON)
    ratios = np.array([[min(ratio, 1.0) for ratio in of_stray], of_on])
    return ratios[on.astype(int), before], min(2 * hole / off_beyond, 1.0), hole_on / off_beyond


def _nats_of_ends(columns: _Columns) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"], float]:
    """Places of an end (in columns, `_STEPS` to each), the logarithms of their likelihoods, and that of no end at all.

    An end's step onwards changes only the columns within the blur's reach, by the same table for each of them. Whole
    columns tell first where an end is likely at all.
    """
    reach, t = _REACH_COLUMNS, (np.arange(-_REACH_COLUMNS * _STEPS, _REACH_COLUMNS * _STEPS + 1) + 0.5) / _STEPS
    whole = np.zeros(len(columns.on) + 1)  # of an end behind so many columns, without blur
    np.cumsum(_nats_of_column(columns, np.array([np.inf]))[:, 0], out=whole[1:])
    likely = np.flatnonzero(whole > whole.max() - _NEGLIGIBLE_NATS)
    first, last = max(int(likely[0]) - 2 * reach, 0), min(int(likely[-1]) + 2 * reach, len(columns.on))
    nats = _nats_of_column(columns.between(first, last), t)
    gained = nats[:, 1:] - nats[:, :-1]
    steps = np.zeros((last - first + 2 * reach - 1, _STEPS))  # from an end `reach` columns before the first onwards
    for block in range(2 * reach):
        steps[block : block + last - first] += gained[:, block * _STEPS : (block + 1) * _STEPS]
    ends = first + (np.arange(1, steps.size + 1) + 0.5) / _STEPS - reach
    inside = (ends > first - 0.5) & (ends < last - 0.5)
    return ends[inside], float(whole[first]) + np.cumsum(steps)[inside], float(whole[-1])


def _nats_of_column(columns: _Columns, t: Float[np.ndarray, "k"]) -> Float[np.ndarray, "m k"]:
    """How much likelier each column is `t` columns inside the end than far beyond it (natural logarithm)."""
    on, inside = columns.on[:, None], columns.inside[:, None]
    if math.isnan(columns.log_light[0]):
        return np.log(np.where(t > 0, inside, 1.0))
    share = np.maximum(ndtr(t / _BLUR_COLUMNS), _FAINTEST)
    light, sigma = columns.log_light[:, None], columns.log_light_sigma
    fewer = (light - np.log(share)) / sigma
    by_chance = np.log(_WIDE) + 0.5 * np.square(light / (_WIDE * sigma))
    seen = 1 + inside * np.exp(np.minimum(by_chance - 0.5 * np.square(fewer), 50.0))
    below = (1 - share) * ndtr(fewer)
    stray = np.maximum(inside, np.where(np.abs(t) <= _MIXED_COLUMNS, _LOST_AT_EDGE, 0.0))
    return np.log(np.where(on, seen, below + (1 - below) * stray))
