"""A gently curved surface z(x, y), and paths on it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadGeometry
from weldcell.models.seam_path import PathFrames, PlanePath

_NEWTON_STEPS = 8
_SOLVED_M = 1e-13


@dataclass(frozen=True, kw_only=True)
class CurvedSurface:
    """z = height + wave cos(2 pi x / wavelength) - y^2 / (2 radius) + twist x y: domed, hollow and twisted."""

    height_m: float
    """Above the underside in the middle, less the wave."""
    wave_m: float
    """How far the wave along x swings up and down."""
    wavelength_m: float
    """Its length; its crests have a radius of wavelength^2 / (4 pi^2 wave)."""
    across_radius_m: float
    """Radius of the parabola across, at its top; positive falls to both sides."""
    twist: float = 0.0
    """Change of the slope across with each metre along, 1/m."""

    def __post_init__(self) -> None:
        values = np.array(list(vars(self).values()))
        if not np.all(np.isfinite(values)) or self.wavelength_m <= 0 or self.across_radius_m == 0:
            raise BadGeometry(
                f"surface: expected finite sizes, a positive wavelength and a radius other than 0, found {vars(self)}"
            )

    def height(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """z(x, y), m."""
        k = 2 * np.pi / self.wavelength_m
        return self.height_m + self.wave_m * np.cos(k * x) - y**2 / (2 * self.across_radius_m) + self.twist * x * y

    def slopes(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """dz/dx and dz/dy."""
        k = 2 * np.pi / self.wavelength_m
        return -self.wave_m * k * np.sin(k * x) + self.twist * y, -y / self.across_radius_m + self.twist * x

    def met_from(
        self, points: Float[np.ndarray, "*n 3"], directions: Float[np.ndarray, "*n 3"]
    ) -> Float[np.ndarray, "*n 3"]:
        """Where lines through these points meet the surface, near the points (Newton's method)."""
        for _ in range(_NEWTON_STEPS):
            x, y, z = np.moveaxis(points, -1, 0)
            slope_x, slope_y = self.slopes(x, y)
            above = z - self.height(x, y)
            rate = directions[..., 2] - slope_x * directions[..., 0] - slope_y * directions[..., 1]
            points = points - (above / rate)[..., None] * directions
        x, y, z = np.moveaxis(points, -1, 0)
        if not np.all(np.abs(z - self.height(x, y)) < _SOLVED_M):
            raise BadGeometry("surface: a wall does not meet it; expected a gentler surface or a smaller groove")
        return points


@dataclass(frozen=True, kw_only=True)
class SurfacePath:
    """A plane path laid on a surface from above; its section is upright along the surface's normal."""

    plan: PlanePath
    """The path seen from above."""
    surface: CurvedSurface
    """What it lies on."""

    @property
    def length_m(self) -> float:
        """The part's length along x."""
        return self.plan.length_m

    def frames(self, x: Float[np.ndarray, "n"]) -> PathFrames:
        """Where the section stands at these x (m)."""
        y = self.plan.height(x)
        slope_x, slope_y = self.surface.slopes(x, y)
        ups = _unit(np.column_stack([-slope_x, -slope_y, np.ones_like(x)]))
        along = self.plan.slope(x)
        tangents = _unit(np.column_stack([np.ones_like(x), along, slope_x + slope_y * along]))
        points = np.column_stack([x, y, self.surface.height(x, y)])
        return PathFrames(points=points, tangents=tangents, lefts=np.cross(ups, tangents), ups=ups)


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
