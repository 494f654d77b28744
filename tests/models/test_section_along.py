"""Joints whose gap or height changes along the path, measured against what was asked for at each place."""

from dataclasses import replace

import numpy as np
import pytest

from models.path_slices import place_and_axes, slice_mm
from weldcell.cell.errors import BadGeometry
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSize
from weldcell.models.seam_path import ArcPath, SPath, StraightPath
from weldcell.models.swept_joint import TackWelds, joint_part, joint_seam

L, W, DEG = 0.3, 0.12, np.pi / 180
MESH_MM = 0.7e-3  # the mesh's chords stray by 0.5 um along the path, and the gap by 0.1 um between its stations
SEAM_M = 1.2e-8  # the seam's chords stray by 1e-8 m
PATHS = {
    "straight": StraightPath(length_m=L),
    "s": SPath(length_m=L, amplitude_m=0.02),
    "arc": ArcPath(length_m=L, radius_m=-0.25),
}
SIZES = {
    "butt": JointSize(thickness_m=6e-3),
    "v": JointSize(thickness_m=12e-3, groove_angle_rad=60 * DEG, root_face_m=2e-3),
    "v-gap": JointSize(thickness_m=12e-3, groove_angle_rad=60 * DEG, root_face_m=2e-3),
    "bevel": JointSize(thickness_m=12e-3, groove_angle_rad=45 * DEG, root_face_m=2e-3),
    "lap": JointSize(thickness_m=6e-3, upper_thickness_m=4e-3),
    "fillet": JointSize(thickness_m=8e-3, upper_thickness_m=6e-3, rise_m=50e-3),
}
TAN_30 = np.tan(30 * DEG)
CORNERS = {  # (left, up) in mm of every edge that moves, for a gap g in mm
    "butt": lambda g: [(s * g / 2, z) for s in (1, -1) for z in (0, 6)],
    "v": lambda g: [(s * (g / 2 + x), z) for s in (1, -1) for x, z in ((0, 0), (0, 2), (10 * TAN_30, 12))],
    "v-gap": lambda g: [(s * (g / 2 + x), z) for s in (1, -1) for x, z in ((0, 0), (0, 2), (10 * TAN_30, 12))],
    "bevel": lambda g: [(g / 2, 0), (g / 2, 2), (g / 2 + 10, 12), (-g / 2, 0), (-g / 2, 12)],
    "fillet": lambda g: [(0, 8 + g), (6, 8 + g), (0, 58 + g), (6, 58 + g)],
}
CLOSING = {"end_share": 2 / 3}  # 1 mm at the start, 0 from two thirds of the length on


def changing(kind, path, start_mm, end_mm, tacks=None, **more):
    first, last = (
        joint_section(kind, replace(SIZES[kind], root_gap_m=1e-3 * gap), may_close=True) for gap in (start_mm, end_mm)
    )
    return joint_part(first, path, W, tacks, end_section=last, **more)


def gap_mm(x, start_mm, end_mm, end_share=1.0):
    return start_mm + (end_mm - start_mm) * min((x / L + 0.5) / end_share, 1.0)


@pytest.fixture(scope="module", params=[(k, p) for k in CORNERS for p in PATHS], ids=" ".join)
def closing(request):
    kind, path = request.param
    return kind, PATHS[path], changing(kind, PATHS[path], 1.0, 0.0, **CLOSING)


def test_gap_closes_where_it_should_and_stays_closed(closing):
    """At places all along: edges where the gap puts them; nothing within the metal once it is closed."""
    kind, path, part = closing
    for x in np.linspace(-0.13, 0.13, 14):
        gap, ends = gap_mm(x, 1.0, 0.0, **CLOSING), slice_mm(part, path, x)
        corners = np.array(
            [c for c in CORNERS[kind](gap) if gap > 0 or kind == "fillet" or c[1] > 6 - 1e-9 or c[1] == 2]
        )
        if gap == 0 and kind in ("butt", "fillet"):  # no edges are left where the members are flush
            inside = (np.abs(ends[:, 0]) < 2.9) & (ends[:, 1] > 0.1) & (ends[:, 1] < (5.9 if kind == "butt" else 7.9))
            assert not inside.any()
            continue
        assert np.linalg.norm(corners[:, None] - ends, axis=2).min(axis=1).max() < MESH_MM


def test_a_closing_joint_is_one_whole_solid(closing):
    _, _, part = closing
    mesh = part.mesh_part()
    assert mesh.is_watertight and mesh.body_count == 1
    assert mesh.euler_number == 2  # a slit that ends is no hole


def test_seam_is_exact_where_the_gap_changes_and_where_it_is_closed(closing):
    """Left and right edges half a gap further out, over the whole length, between its samples too."""
    kind, path, part = closing
    seam = part.seam_part
    ends = np.abs([line[[0, -1], 0] for line in seam.points.values()])
    np.testing.assert_allclose(ends.max(axis=0), L / 2, atol=1e-9)  # m
    for name, (across, up) in FEATURES[kind].items():
        sign = {"left": 1, "right": -1}.get(name, 0)
        for x in (-0.1213, -0.04, 0.0487, 0.0499, 0.0503, 0.11):
            point, _, left = place_and_axes(path, x)
            gap_m = 1e-3 * gap_mm(x, 1.0, 0.0, **CLOSING)
            expected = point + (1e-3 * across + sign * gap_m / 2) * left + [0, 0, 1e-3 * up]
            assert distance_m(expected, seam.points[name]) < SEAM_M


FEATURES = {  # (left, up) in mm without the gap
    "butt": {"left": (0, 6), "right": (0, 6)},
    "v": {"left": (10 * TAN_30, 12), "root": (0, 2), "right": (-10 * TAN_30, 12)},
    "v-gap": {"left": (10 * TAN_30, 12), "root": (0, 2), "right": (-10 * TAN_30, 12)},
    "bevel": {"left": (10, 12), "root": (0, 2), "right": (0, 12)},
    "fillet": {"root": (0, 8)},
}


def distance_m(point, line):
    """Distance of a point to a polyline."""
    step = np.diff(line, axis=0)
    share = np.clip(np.einsum("ni,ni->n", point - line[:-1], step) / np.sum(step**2, axis=1), 0, 1)
    return np.linalg.norm(line[:-1] + share[:, None] * step - point, axis=1).min()


@pytest.mark.parametrize("kind", ["butt", "v", "bevel"])
def test_volume_is_that_of_the_mean_gap(kind):
    """Straight: area of the closed section times the length, less thickness times the gap's integral."""
    groove_mm2 = {"butt": 0, "v": 100 * TAN_30, "bevel": 50}[kind]
    thickness_mm = 1e3 * SIZES[kind].thickness_m
    for start_mm, end_mm, share in ((1.0, 0.0, 2 / 3), (0.5, 2.0, 1.0), (2.0, 1.0, 0.25)):
        part = changing(kind, PATHS["straight"], start_mm, end_mm, end_share=share)
        mean_mm = share * (start_mm + end_mm) / 2 + (1 - share) * end_mm
        expected_mm3 = 300 * (120 * thickness_mm - groove_mm2 - thickness_mm * mean_mm)
        assert 1e9 * part.mesh_part().volume == pytest.approx(expected_mm3, rel=1e-8)  # rounding of the mesh


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("kind", CORNERS)
def test_a_gap_that_opens_is_measured_at_every_place(kind, path):
    part = changing(kind, PATHS[path], 0.5, 3.0)
    for x in np.linspace(-0.13, 0.13, 7):
        corners, ends = np.array(CORNERS[kind](gap_mm(x, 0.5, 3.0))), slice_mm(part, PATHS[path], x)
        assert np.linalg.norm(corners[:, None] - ends, axis=2).min(axis=1).max() < MESH_MM
    assert part.mesh_part().body_count == 2


@pytest.mark.parametrize("path", PATHS)
def test_the_upper_plate_of_a_lap_lies_askew_over_a_gap_that_opens(path):
    """It is turned as a whole: its heights go with x, and its volume stays."""
    path, part = PATHS[path], changing("lap", PATHS[path], 0.5, 2.0)
    assert part.vertices_part[:, 2].max() == pytest.approx(12e-3, abs=1e-12)  # m: 6 + 2 + 4 mm at the far end
    for x in np.linspace(-0.13, 0.13, 7):
        corners = np.array([(0, 6 + gap_mm(x, 0.5, 2.0)), (0, 10 + gap_mm(x, 0.5, 2.0))])
        ends = slice_mm(part, path, x)
        assert np.linalg.norm(corners[:, None] - ends, axis=2).min(axis=1).max() < MESH_MM
        point, _, _ = place_and_axes(path, x)
        edge = part.seam_part.points["edge"]
        assert distance_m(point + [0, 0, 1e-3 * corners[1, 1]], edge) < SEAM_M
    level = changing("lap", path, 0.5, 0.5)
    assert part.mesh_part().volume == pytest.approx(level.mesh_part().volume, rel=1e-7)


@pytest.mark.parametrize("path", PATHS)
def test_a_height_mismatch_grows_along_the_path(path):
    """The left plate lies askew: its edge is as high as the x of its own points says, the right one's stays."""
    path = PATHS[path]
    first, last = (joint_section("v", replace(SIZES["v"], root_gap_m=1e-3, mismatch_m=m)) for m in (0.2e-3, 1e-3))
    part = joint_part(first, path, W, end_section=last)
    left, right = part.seam_part.points["left"], part.seam_part.points["right"]
    np.testing.assert_allclose(left[:, 2], 12e-3 + 0.2e-3 + 0.8e-3 * (left[:, 0] / L + 0.5), atol=1e-12)
    np.testing.assert_allclose(right[:, 2], 12e-3, atol=1e-15)
    for x in (-0.12, -0.03, 0.1):
        point, tangent, across = place_and_axes(path, x)
        for line in (left, right):
            ahead = (line - point) @ tangent
            k = int(np.flatnonzero((ahead[:-1] < 0) & (ahead[1:] >= 0))[0])
            feature = line[k] - ahead[k] / (ahead[k + 1] - ahead[k]) * (line[k + 1] - line[k])
            corner = 1e3 * np.array([(feature - point) @ across, feature[2]])
            assert np.linalg.norm(corner - slice_mm(part, path, x), axis=1).min() < MESH_MM


def test_tacks_bridge_a_gap_that_opens():
    tacks = TackWelds(stations_m=(0.05, 0.15, 0.25))
    part = changing("butt", PATHS["s"], 0.5, 2.5, tacks)
    mesh = part.mesh_part()
    assert mesh.body_count == 1
    assert mesh.euler_number == 2 - 2 * 2  # three bridges leave two holes


def test_the_seam_alone_is_the_parts():
    first, last = (joint_section("v", replace(SIZES["v"], root_gap_m=gap)) for gap in (1e-3, 0.0))
    seam = joint_seam(first, PATHS["s"], last, 0.5)
    part = joint_part(first, PATHS["s"], W, end_section=last, end_share=0.5)
    for name, line in seam.points.items():
        np.testing.assert_array_equal(line, part.seam_part.points[name])


@pytest.mark.parametrize(
    ("kind", "change", "more", "words"),
    [
        ("v", {"thickness_m": 10e-3}, {}, "another thickness"),
        ("v", {"root_face_m": 0.0}, {}, "same kind and form"),
        ("v", {"mismatch_m": 1e-3}, {"end_share": 0.5}, "can't kink"),
        ("v", {}, {"end_share": 0.0}, "end_share"),
        ("v", {}, {"end_share": np.nan}, "end_share"),
        ("butt", {}, {}, "another joint"),
    ],
)
def test_changes_that_no_joint_makes_are_refused(kind, change, more, words):
    first = joint_section("v", replace(SIZES["v"], root_gap_m=1e-3))
    last = joint_section(kind, replace(SIZES[kind], root_gap_m=1e-3, **change))
    with pytest.raises(BadGeometry, match=words):
        joint_part(first, PATHS["straight"], W, end_section=last, **more)
