"""Targets for calibrating camera and light plane: chessboard, board of parallel lines, target with steps.

A board's frame: x and y along its printed face, z into the plate, so that a camera in front of it that sees x to the
right and y downwards has the board's axes parallel to its own. The print lies in z = 0 and has no thickness.

A printed pattern is a sum of products of two piecewise constant functions, one of x and one of y: exact, whatever the
picture's resolution (`sensor_sim.printed` blurs it as the lens does).
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry
from weldcell.models.finishes import FINISHES
from weldcell.models.mesh_body import BLACK, GROUP_PARTS, PART_MASK, Finish

PLATE_M = 0.006
"""Thickness of a board's plate."""

_PAINT_M = 1e-4  # the white of a step target's levels


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """A piecewise constant function of one coordinate."""

    edges_m: Float[np.ndarray, "k"]
    """Where it changes, ascending."""
    levels: Float[np.ndarray, "k+1"]
    """Its value before the first edge, between the edges and after the last."""

    def __post_init__(self) -> None:
        if len(self.levels) != len(self.edges_m) + 1 or np.any(np.diff(self.edges_m) <= 0):
            raise BadGeometry("board: expected ascending edges and one level more than edges")


@dataclass(frozen=True, kw_only=True, eq=False)
class PatternTerm:
    """One product: weight times a function of x times a function of y."""

    weight: float
    x: Steps
    y: Steps


@dataclass(frozen=True, kw_only=True, eq=False)
class Pattern:
    """Where a board is black: the sum of the terms is 1 on black, 0 on white."""

    terms: tuple[PatternTerm, ...]
    black_ratio: float
    """Brightness of black relative to white."""

    def __post_init__(self) -> None:
        if not 0 <= self.black_ratio < 1:
            raise BadGeometry(f"board: black_ratio is {self.black_ratio}, expected 0 to below 1")

    def blackness(self, points_board: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """1 on black, 0 on white, without any blur."""
        total = np.zeros(len(points_board))
        for term in self.terms:
            value_x, value_y = (
                steps.levels[np.searchsorted(steps.edges_m, points_board[:, axis])]
                for axis, steps in enumerate((term.x, term.y))
            )
            total += term.weight * value_x * value_y
        return total


@runtime_checkable
class Board(Protocol):
    """Anything that can be put before the sensor."""

    @property
    def name(self) -> str: ...
    @property
    def pattern(self) -> Pattern | None: ...
    def add_to(self, spec: mujoco.MjSpec, T_base_board: RigidTransform) -> mujoco.MjsBody: ...


@dataclass(frozen=True, kw_only=True)
class Chessboard:
    """A plate with squares; the frame's origin is the first inner corner, squares beside it on the diagonal alike."""

    columns: int
    """Inner corners along x."""
    rows: int
    """Inner corners along y."""
    square_m: float
    """Side of a square."""
    border_m: float = 0.004
    """White border around the squares."""
    black_ratio: float = 0.06
    """Brightness of black relative to white: what matt print sends back."""
    name: str = "chessboard"
    """Name of its body."""

    def __post_init__(self) -> None:
        if self.columns < 2 or self.rows < 2 or not (self.square_m > 0 and self.border_m > 0):
            raise BadGeometry(
                f"chessboard: {self.columns}x{self.rows} corners, squares {self.square_m} m, border {self.border_m} m, "
                "expected at least 2x2 and lengths above 0"
            )

    @property
    def corners_board(self) -> Float[np.ndarray, "n 3"]:
        """Inner corners (m), row by row."""
        y, x = np.divmod(np.arange(self.columns * self.rows), self.columns)
        return np.column_stack([x, y, np.zeros(len(x))]) * self.square_m

    @property
    def pattern(self) -> Pattern:
        """Black squares: half of (inside minus alternating signs), each a product of x and y."""
        (in_x, signs_x), (in_y, signs_y) = (_inside_and_signs(n, self.square_m) for n in (self.columns, self.rows))
        terms = (PatternTerm(weight=0.5, x=in_x, y=in_y), PatternTerm(weight=-0.5, x=signs_x, y=signs_y))
        return Pattern(terms=terms, black_ratio=self.black_ratio)

    def add_to(self, spec: mujoco.MjSpec, T_base_board: RigidTransform) -> mujoco.MjsBody:
        """The plate's body, standing at `T_base_board`."""
        low = np.full(2, -self.square_m - self.border_m)
        high = np.array([self.columns, self.rows]) * self.square_m + self.border_m
        return _add_plate(spec, self.name, low, high, T_base_board)


@dataclass(frozen=True, kw_only=True)
class LineBoard:
    """A plate with parallel lines along y, evenly spaced along x; the frame's origin is its middle."""

    lines: int
    spacing_m: float
    """Between the middles of neighbouring lines."""
    width_m: float
    """Of a line."""
    length_m: float
    """Of the lines."""
    border_m: float = 0.006
    """White border around the lines."""
    black_ratio: float = 0.06
    """Brightness of black relative to white."""
    name: str = "line_board"
    """Name of its body."""

    def __post_init__(self) -> None:
        if self.lines < 2 or not (0 < self.width_m < self.spacing_m and self.length_m > 0 and self.border_m > 0):
            raise BadGeometry(
                f"line board: {self.lines} lines of {self.width_m} m, {self.spacing_m} m apart and {self.length_m} m, "
                "expected 2 or more, thinner than their spacing"
            )

    @property
    def places_m(self) -> Float[np.ndarray, "lines"]:
        """Middles of the lines along x."""
        return (np.arange(self.lines) - (self.lines - 1) / 2) * self.spacing_m

    @property
    def pattern(self) -> Pattern:
        """Black on the lines."""
        edges = (self.places_m[:, None] + np.array([-0.5, 0.5]) * self.width_m).ravel()
        x = Steps(edges_m=edges, levels=np.append(np.tile([0.0, 1.0], self.lines), 0.0))
        y = Steps(edges_m=np.array([-0.5, 0.5]) * self.length_m, levels=np.array([0.0, 1.0, 0.0]))
        return Pattern(terms=(PatternTerm(weight=1.0, x=x, y=y),), black_ratio=self.black_ratio)

    def add_to(self, spec: mujoco.MjSpec, T_base_board: RigidTransform) -> mujoco.MjsBody:
        """The plate's body, standing at `T_base_board`."""
        half = np.array([self.places_m[-1] + self.width_m / 2, self.length_m / 2]) + self.border_m
        return _add_plate(spec, self.name, -half, half, T_base_board)


@dataclass(frozen=True, kw_only=True, eq=False)
class StepTarget:
    """A block with flat levels one beside the other along x, matt white on top, black at the walls.

    Its frame is the estimator's: z up from the lowest level, x across the step edges, y along them.
    """

    edges_m: tuple[float, ...]
    """Ends of the levels along x, ascending."""
    heights_m: tuple[float, ...]
    """Height of each level; one less than edges."""
    length_m: float
    """Along y."""
    base_m: float = 0.006
    """Of the block below height 0."""
    name: str = "step_target"
    """Name of its body."""

    def __post_init__(self) -> None:
        if len(self.heights_m) != len(self.edges_m) - 1 or np.any(np.diff(self.edges_m) <= 0):
            raise BadGeometry("step target: expected ascending edges and one level less than edges")
        if min(self.heights_m) + self.base_m <= 0 or self.length_m <= 0:
            raise BadGeometry("step target: expected every level above the base's underside, and a length above 0")

    @property
    def pattern(self) -> None:
        """Nothing is printed on it."""
        return None

    @property
    def free_edges(self) -> tuple[tuple[int, int], ...]:
        """(level, edge) of the levels' ends beside which the neighbour lies lower: no wall hides or lights them."""
        last = len(self.heights_m) - 1
        ends = [(j, j + side) for j in range(last + 1) for side in (0, 1)]
        return tuple((j, k) for j, k in ends if k in (0, last + 1) or self.heights_m[j] > self.heights_m[2 * k - 1 - j])

    def add_to(self, spec: mujoco.MjSpec, T_base_board: RigidTransform) -> mujoco.MjsBody:
        """The block's body, standing at `T_base_board`."""
        body = _add_body(spec, self.name, T_base_board)
        half_m = self.length_m / 2
        for k, (left, right, top) in enumerate(zip(self.edges_m[:-1], self.edges_m[1:], self.heights_m, strict=True)):
            block = np.array([[left, -half_m, -self.base_m], [right, half_m, top - _PAINT_M]])
            paint = np.array([[left, -half_m, top - _PAINT_M], [right, half_m, top]])
            _add_box(spec, body, f"{self.name}_block_{k}", block, BLACK, f"{self.name}_block_{k}")
            _add_box(spec, body, f"{self.name}_level_{k}", paint, FINISHES["matt-white"], f"level_{k}/matt-white")
        return body


def _inside_and_signs(corners: int, square_m: float) -> tuple[Steps, Steps]:
    """1 within the squares and 0 outside; +1 and -1 in turn within the squares and 0 outside."""
    edges = np.arange(-1, corners + 1) * square_m
    inside = Steps(edges_m=edges[[0, -1]], levels=np.array([0.0, 1.0, 0.0]))
    signs = np.concatenate([[0.0], (-1.0) ** np.arange(corners + 1), [0.0]])
    return inside, Steps(edges_m=edges, levels=signs)


def _add_plate(
    spec: mujoco.MjSpec,
    name: str,
    low: Float[np.ndarray, "2"],
    high: Float[np.ndarray, "2"],
    T_base_board: RigidTransform,
) -> mujoco.MjsBody:
    body = _add_body(spec, name, T_base_board)
    box = np.array([[*low, 0.0], [*high, PLATE_M]])
    _add_box(spec, body, name, box, FINISHES["matt-white"], f"{name}/matt-white")
    return body


def _add_box(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, box: Float[np.ndarray, "2 3"], finish: Finish, material: str
) -> None:
    """A box between two corners (m), without highlights: matt paint and print show none."""
    drawn = spec.add_material(name=material, rgba=finish.rgba, specular=0.0, shininess=0.0)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=box.mean(axis=0),
        size=(box[1] - box[0]) / 2,
        material=drawn.name,
        rgba=finish.rgba,
        group=GROUP_PARTS,
        contype=PART_MASK.contype,
        conaffinity=PART_MASK.conaffinity,
        mass=0,
    )


def _add_body(spec: mujoco.MjSpec, name: str, T_base_board: RigidTransform) -> mujoco.MjsBody:
    quaternion = T_base_board.rotation.as_quat(scalar_first=True)
    return spec.worldbody.add_body(name=name, pos=T_base_board.translation, quat=quaternion, mocap=True)
