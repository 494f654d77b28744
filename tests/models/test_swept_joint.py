"""Meshes of joints, sliced across their paths, against outlines worked out by hand; volumes, tacks, refusals."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.path_slices import place_and_axes, segments_mm, slice_mm
from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import translation
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSize
from weldcell.models.seam_path import ArcPath, SPath, StraightPath
from weldcell.models.swept_joint import TackWelds, joint_part

L, W, DEG = 0.3, 0.12, np.pi / 180
MESH_MM = 0.6e-3  # the mesh's chords stray by 0.5 um along the path; 0.1 um for what chords do between stations
ARC_MM = 2.6e-3  # and by 2 um more where the section is rounded
PATHS = {
    "straight": StraightPath(length_m=L),
    "s": SPath(length_m=L, amplitude_m=0.02),
    "arc": ArcPath(length_m=L, radius_m=-0.25),
}
SIZES = {
    "butt": JointSize(thickness_m=6e-3, root_gap_m=2e-3),
    "v": JointSize(thickness_m=12e-3, groove_angle_rad=60 * DEG, root_face_m=2e-3),
    "v-gap": JointSize(
        thickness_m=12e-3, groove_angle_rad=60 * DEG, root_face_m=2e-3, root_gap_m=2e-3, mismatch_m=1e-3
    ),
    "bevel": JointSize(thickness_m=12e-3, groove_angle_rad=45 * DEG, root_face_m=2e-3, mismatch_m=-1e-3),
    "u": JointSize(thickness_m=20e-3, groove_angle_rad=20 * DEG, root_face_m=3e-3, root_radius_m=6e-3),
    "j": JointSize(thickness_m=20e-3, groove_angle_rad=20 * DEG, root_face_m=3e-3, root_radius_m=6e-3, root_gap_m=1e-3),
    "lap": JointSize(thickness_m=6e-3, upper_thickness_m=4e-3, root_gap_m=0.5e-3),
    "fillet": JointSize(thickness_m=8e-3, upper_thickness_m=6e-3, rise_m=50e-3),
    "corner": JointSize(thickness_m=8e-3, groove_angle_rad=90 * DEG, root_face_m=1e-3, rise_m=50e-3),
}
SLICES = (-0.0713, 0.0127, 0.0948)
# What a slice shows within 30 mm of the path, in mm (left, up): open lines, without the ends that the part has anyway.
OUTLINES = {
    "butt": [[(30, 0), (1, 0), (1, 6), (30, 6)], [(-30, 0), (-1, 0), (-1, 6), (-30, 6)]],
    "v": [[(30, 12), (5.773503, 12), (0, 2), (-5.773503, 12), (-30, 12)], [(30, 0), (-30, 0)]],
    "v-gap": [
        [(30, 1), (1, 1), (1, 3), (6.773503, 13), (30, 13)],
        [(-30, 0), (-1, 0), (-1, 2), (-6.773503, 12), (-30, 12)],
    ],
    "bevel": [
        [(30, 12), (10, 12), (0, 2), (0, 13), (-30, 13)],
        [(30, 0), (0, 0), (0, 1), (-30, 1)],
    ],
    "lap": [
        [(30, 6.5), (0, 6.5), (0, 10.5), (30, 10.5)],
        [(30, 0), (-30, 0)],
        [(30, 6), (-30, 6)],
    ],
    "fillet": [[(30, 8), (6, 8), (6, 58), (0, 58), (0, 8), (-30, 8)], [(30, 0), (-30, 0)]],
    "corner": [
        [(46.669, 0), (5.156854, 41.512193), (0, 36.355339), (-5.156854, 41.512193), (-46.669, 0)],
        [(35.355339, 0), (0, 35.355339), (-35.355339, 0)],
        [(46.669, 0), (35.355339, 0)],
        [(-46.669, 0), (-35.355339, 0)],
    ],
}
CORNERS = {  # every corner of a slice that is an edge of the part; V without gap and all: between 20 mm either side
    kind: [point for line in lines for point in line if abs(point[0]) < 20] for kind, lines in OUTLINES.items()
}


def path_x(path, point, across):
    """The place on the path beside which this feature point lies."""
    x = point[0]
    for _ in range(60):
        place, _, left = place_and_axes(path, x)
        x += point[0] - (place + across * left)[0]
    return x


def distance_mm(points, lines):
    """Distance of points to the nearest of some open polylines in the plane."""
    steps = np.array([pair for line in lines for pair in pairwise(np.asarray(line, float))])
    steps = steps[np.linalg.norm(steps[:, 1] - steps[:, 0], axis=1) > 1e-9]
    starts, along = steps[:, 0], steps[:, 1] - steps[:, 0]
    share = np.einsum("nmk,mk->nm", points[:, None] - starts, along) / np.sum(along**2, axis=1)
    feet = starts + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - feet, axis=2).min(axis=1)


@pytest.fixture(scope="module")
def parts():
    """Each part is made once."""
    return {
        (kind, name): joint_part(joint_section(kind, SIZES[kind]), path, W)
        for kind in SIZES
        for name, path in PATHS.items()
    }


@pytest.fixture(params=[(k, p) for p in PATHS for k in SIZES], ids=lambda kp: f"{kp[0]} {kp[1]}")
def joint(request, parts):
    kind, path = request.param
    return kind, PATHS[path], parts[kind, path]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("kind", OUTLINES)
def test_slices_across_the_path_are_the_joints_outline(parts, kind, path):
    """Every end of the slice lies on the outline, and every corner of the outline is an end of the slice."""
    for x in SLICES:
        ends = slice_mm(parts[kind, path], PATHS[path], x)
        assert distance_mm(ends, OUTLINES[kind]).max() < MESH_MM
        corners = np.array(CORNERS[kind])
        assert np.linalg.norm(corners[:, None] - ends, axis=2).min(axis=1).max() < MESH_MM


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(("kind", "half_gap", "lean_deg", "top"), [("u", 0, 10, 8.032157), ("j", 0.5, 20, 10.888740)])
def test_slices_of_rounded_grooves_have_their_radius_walls_and_edges(parts, kind, path, half_gap, lean_deg, top):
    tangent_z = 9 - 6 * np.sin(lean_deg * DEG)
    for x in SLICES:
        ends = slice_mm(parts[kind, path], PATHS[path], x)
        groove = ends[(ends[:, 1] > 3 - 1e-3) & (ends[:, 1] < 20 - 1e-3) & (np.abs(ends[:, 0]) < 12)]
        across, up = np.abs(groove[:, 0]) if kind == "u" else groove[:, 0], groove[:, 1]
        rounded = (across > half_gap) & (up < tangent_z)
        assert rounded.sum() > 20
        assert np.abs(np.hypot(across[rounded] - half_gap, up[rounded] - 9) - 6).max() < ARC_MM
        wall = (up > tangent_z + 1e-2) & (across > 0)
        expected = top - (20 - up[wall]) * np.tan(lean_deg * DEG)
        assert np.abs(across[wall] - expected).max() < MESH_MM
        corners = np.array(
            [(top, 20), (-top, 20), (0, 3)] if kind == "u" else [(top, 20), (-0.5, 20), (-0.5, 0), (0.5, 0), (0.5, 3)]
        )
        assert np.linalg.norm(corners[:, None] - ends, axis=2).min(axis=1).max() < MESH_MM


def test_seam_is_the_features_led_along_the_path(joint):
    kind, path, part = joint
    seam, section = part.seam_part, joint_section(kind, SIZES[kind])
    assert list(seam.points) == list(section.features)
    k = np.arange(7, len(seam.arc_length_m), 131)
    for name, (across, up) in section.features.items():
        line = seam.points[name]
        for i in k:
            x = line[i, 0]  # of the path, by a few fixed-point steps: the feature lies beside it
            for _ in range(60):
                point, _, left = place_and_axes(path, x)
                x += line[i, 0] - (point + across * left)[0]
            np.testing.assert_allclose(line[i], point + across * left + [0, 0, up], atol=1e-10)  # m
    ends = np.abs([points[[0, -1], 0] for points in seam.points.values()])
    assert ends.max() == pytest.approx(L / 2, abs=1e-9)


def test_arc_length_is_the_paths(joint):
    """Against a fine polygon of the path between the places beside which the seam's features begin and end."""
    kind, path, part = joint
    name, (across, _) = next(iter(joint_section(kind, SIZES[kind]).features.items()))
    ends = [path_x(path, part.seam_part.points[name][k], across) for k in (0, -1)]
    polygon = np.array([place_and_axes(path, x)[0] for x in np.linspace(*ends, 2001)])
    length = np.linalg.norm(np.diff(polygon, axis=0), axis=1).sum()
    assert part.seam_part.arc_length_m[0] == 0
    assert part.seam_part.arc_length_m[-1] == pytest.approx(length, abs=2e-8)  # m: sagittas of 0.15 mm steps


def test_approach_is_a_unit_vector_across_the_path_out_of_the_joint(joint):
    kind, path, part = joint
    seam = part.seam_part
    np.testing.assert_allclose(np.linalg.norm(seam.approach, axis=1), 1, atol=1e-12)
    along = np.gradient(next(iter(seam.points.values())), seam.arc_length_m, axis=0)
    assert np.abs(np.einsum("ni,ni->n", seam.approach, along))[1:-1].max() < 1e-4  # numerical tangent
    assert np.all(seam.approach[:, 2] == pytest.approx(np.sqrt(0.5) if kind in ("lap", "fillet") else 1.0))
    if kind in ("lap", "fillet") and isinstance(path, StraightPath):
        assert np.all(seam.approach[:, 1] < -0.7)  # away from the wall on the left


def test_solids_are_as_many_as_the_members_that_do_not_touch(joint):
    kind, _, part = joint
    separate = {"butt", "v-gap", "j", "lap"}
    mesh = part.mesh_part()
    assert mesh.body_count == (2 if kind in separate else 1)
    assert mesh.euler_number == 2 * mesh.body_count  # no cracks where members touch
    np.testing.assert_allclose(mesh.bounds[:, 0], [-L / 2, L / 2], atol=1e-12)
    assert mesh.bounds[0, 2] == 0


def test_triangles_are_few(joint):
    kind, _, part = joint
    assert len(part.faces) < (50_000 if kind in ("u", "j") else 10_000)


@pytest.mark.parametrize(
    ("kind", "area_mm2"),
    [
        ("butt", 2 * 59 * 6),
        ("v", 120 * 12 - 5.773503 * 10),
        ("v-gap", 2 * (59 * 12) - 5.773503 * 10),
        ("bevel", 120 * 12 - 50),
        ("lap", 120 * 6 + 60 * 4),
        ("fillet", 120 * 8 + 6 * 50),
        # Wall 0..t of a U: arc sector (pi/2 - lean) 6^2 / 2, triangle under it 6^2 sin cos / 2, trapezoid above.
        (
            "u",
            120 * 20
            - 2
            * (
                36 / 2 * (80 * DEG)
                - 36 / 2 * np.sin(10 * DEG) * np.cos(10 * DEG)
                + (5.908847 + 8.032157) / 2 * (20 - 7.958111)
            ),
        ),
        # For each half: below the V's wall, below the plate's outer side, less what is below its inner side.
        ("corner", (36.355339 + 41.512193) * 5.156854 + 41.512193**2 - 35.355339**2),
    ],
)
def test_straight_volumes_are_area_times_length(kind, area_mm2):
    volume = joint_part(joint_section(kind, SIZES[kind]), PATHS["straight"], W).mesh_part().volume
    rounding = 2 * 6 * 1.4 * 2e-3 if kind == "u" else 2e-4  # mm2: two arcs times the chord; digits of the areas above
    assert 1e9 * volume / 300 == pytest.approx(area_mm2, abs=rounding)


def test_v_on_an_arc_has_the_volume_of_pappus():
    """Cut by planes through the centre, the groove's volume is area times the length of its centroid's circle.

    The part is cut at x = +-L/2 instead; for the groove alone, in slices of equal height, that is
    2 theta(d) / 2 integrated over offsets d, theta(d) = asin(L / 2 / (R - d)): done here by quadrature.
    """
    radius = 0.3
    part = joint_part(joint_section("v", SIZES["v"]), ArcPath(length_m=L, radius_m=radius), W)
    z = (np.arange(400) + 0.5) / 400 * 10e-3
    half = z * np.tan(30 * DEG)

    def strip(a):  # integral of 2 asin(L / 2 / (R - d)) (R - d) over d from -a to a
        d = a[:, None] * ((np.arange(400) + 0.5) / 200 - 1)
        return np.sum(2 * np.arcsin(L / 2 / (radius - d)) * (radius - d), axis=1) * a / 200

    groove = np.sum(strip(half)) * 10e-3 / 400
    assert part.mesh_part().volume == pytest.approx(L * W * 12e-3 - groove, rel=1e-6)


@pytest.mark.parametrize("kind", SIZES)
def test_tacks_fill_the_joint_and_leave_its_edges(parts, kind):
    """At a tack's middle new metal reaches 30 to 80 % of the depth (of a lap's or fillet's corner: 2 to 5 mm), the
    edges are where they were; between tacks the slice is as without.
    """
    section, path, plain = joint_section(kind, SIZES[kind]), PATHS["s"], parts[kind, "s"]
    tacked = joint_part(section, path, W, TackWelds(stations_m=(0.08, 0.2), length_m=0.02))
    assert tacked.mesh_part().body_count == 1
    name, (across, _) = next(iter(section.features.items()))
    tack_x, free_x = (path_x(path, tacked.seam_part.at(name, np.array([s]))[0], across) for s in (0.08, 0.14))
    np.testing.assert_allclose(tacked.seam_part.points[name], plain.seam_part.points[name])
    assert distance_mm(slice_mm(tacked, path, free_x), segments_mm(plain, path, free_x)).max() < MESH_MM
    filled = slice_mm(tacked, path, tack_x)
    for edge in {"left", "right", "edge"} & section.features.keys():
        assert np.linalg.norm(1e3 * section.features[edge] - filled, axis=1).min() < MESH_MM
    new = filled[distance_mm(filled, segments_mm(plain, path, tack_x)) > 0.01]
    if kind in ("lap", "fillet"):
        reach = np.hypot(*(new - 1e3 * section.features["root"]).T)
        assert 2 < reach.max() < 5
    else:
        top = 1e3 * min(section.features[edge][1] for edge in ("left", "right"))
        middle = next((place for name, place in section.features.items() if name in ("root", "centre")), np.zeros(2))
        assert 0.3 < (new[:, 1].max() - 1e3 * middle[1]) / (top - 1e3 * middle[1]) < 0.8


@pytest.mark.parametrize("kind", ["butt", "u", "fillet", "corner"])
def test_joints_take_material_and_texture_and_stand_in_mujoco(kind):
    part = joint_part(joint_section(kind, SIZES[kind]), PATHS["straight"], 0.06, name="joint")
    painted = part.with_surface("ground-steel", "brushed")
    spec = mujoco.MjSpec()
    painted.add_to(spec, translation([0.1, 0.2, 0.3]))
    model = spec.compile()
    assert model.ngeom == 1
    assert model.mesh_facenum[0] == len(part.faces)


def test_tack_spots_lie_along_the_middle_of_a_gap():
    """A butt has no root: the spots are dark midway between its edges, where their rims reach the plates."""
    part = joint_part(joint_section("butt", SIZES["butt"]), PATHS["straight"], 0.06).with_surface(
        "stainless", "none", 1
    )
    middle = part.seam_part.at("left", np.array([L / 2]))[0]
    up = np.array([[0.0, 0.0, 1.0]])
    assert part.texture.factor(middle[None], up)[0] < 0.5
    assert part.texture.factor(middle[None] + [0.05, 0, 0], up)[0] == 1.0


@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    thickness=st.floats(3e-3, 40e-3),
    angle=st.floats(10 * DEG, 100 * DEG),
    gap=st.sampled_from([0.0, 0.5e-3, 3e-3]),
    face_share=st.floats(0.1, 0.5),
    mismatch_share=st.floats(-0.09, 0.09),
    amplitude=st.floats(0, 0.025),
)
def test_random_grooves_are_whole_and_exact(thickness, angle, gap, face_share, mismatch_share, amplitude):
    """Edges of the slice in the middle (where the S heads off its axis the most) against the groove's definition."""
    face, mismatch = face_share * thickness, mismatch_share * thickness
    size = JointSize(
        thickness_m=thickness, groove_angle_rad=angle, root_gap_m=gap, root_face_m=face, mismatch_m=mismatch
    )
    path = SPath(length_m=L, amplitude_m=amplitude)
    part = joint_part(joint_section("v", size), path, 0.2)
    ends = slice_mm(part, path, 0.0003)
    half_top = gap / 2 + (thickness - face) * np.tan(angle / 2)
    rises = max(mismatch, 0), max(-mismatch, 0)
    for sign, rise in zip((1, -1), rises, strict=True):
        edge = 1e3 * np.array([sign * half_top, thickness + rise])
        if abs(edge[0]) < 29:
            assert np.linalg.norm(edge - ends, axis=1).min() < MESH_MM
    assert part.mesh_part().body_count == (1 if gap == 0 else 2)


@pytest.mark.parametrize(
    ("kind", "path", "width", "more", "words"),
    [
        ("v", SPath(length_m=0.3, amplitude_m=0.5), 1.8, {}, "radius of curvature"),
        ("v", SPath(length_m=0.3, amplitude_m=0.05), 0.1, {}, "half the width"),
        ("v", SPath(length_m=0.3, amplitude_m=0.02), 0.0, {}, "width_m"),
        ("v", SPath(length_m=0.3, amplitude_m=0.02), 0.2, {"spacing_m": 1e-7}, "cross-sections"),
        ("corner", ArcPath(length_m=0.3, radius_m=0.18), 0.2, {}, "turns too far"),
        ("fillet", StraightPath(length_m=0.3), 0.2, {"tacks": TackWelds(stations_m=(0.001,))}, "stations_m"),
        ("fillet", StraightPath(length_m=0.3), 0.2, {"tacks": TackWelds(stations_m=(0.1, 0.11))}, "between them"),
        ("fillet", StraightPath(length_m=0.3), 0.2, {"tacks": TackWelds(stations_m=(0.1,), length_m=-1)}, "length_m"),
    ],
)
def test_impossible_parts_are_refused(kind, path, width, more, words):
    with pytest.raises(BadGeometry, match=words):
        joint_part(joint_section(kind, SIZES[kind]), path, width, **more)


@pytest.mark.parametrize(
    ("path", "sizes", "words"),
    [
        (SPath, {"length_m": 0.3, "amplitude_m": np.nan}, "amplitude_m"),
        (StraightPath, {"length_m": 0.0}, "positive"),
        (ArcPath, {"length_m": 0.3, "radius_m": 0.16}, "radius_m"),
        (ArcPath, {"length_m": 0.3, "radius_m": np.inf}, "finite"),
    ],
)
def test_impossible_paths_are_refused(path, sizes, words):
    with pytest.raises(BadGeometry, match=words):
        path(**sizes)
