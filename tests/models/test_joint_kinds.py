"""Sections of joints against places worked out by hand (mm), and joints that cannot be."""

import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import Bar, FullPlate, JointSize, PlateEdge

DEG = np.pi / 180
EXACT_MM = 1e-6  # the places below are given to a nanometre

# kind, sizes (mm, deg), features (mm). U: 10 deg walls, tangent at 6 cos 10 = 5.908847, 3 + 6 (1 - sin 10) = 7.958111.
# J: 20 deg wall, tangent at 0.5 + 6 cos 20 = 6.138156, 6.947879, right side 1 higher.
# Corner: D sqrt 2 = 8 - 1 / sqrt 2.
JOINTS = {
    "butt": ({"thickness": 6, "root_gap": 2}, {"left": (1, 6), "right": (-1, 6)}),
    "v": (
        {"thickness": 12, "angle": 60, "root_face": 2},
        {"left": (5.773503, 12), "root": (0, 2), "right": (-5.773503, 12)},
    ),
    "v-gap": (
        {"thickness": 12, "angle": 60, "root_face": 2, "root_gap": 2, "mismatch": 1},
        {"left": (6.773503, 13), "root": (0, 2.5), "right": (-6.773503, 12)},
    ),
    "bevel": (
        {"thickness": 12, "angle": 45, "root_face": 2},
        {"left": (10, 12), "root": (0, 2), "right": (0, 12)},
    ),
    "u": (
        {"thickness": 20, "angle": 20, "root_face": 3, "root_radius": 6},
        {"left": (8.032157, 20), "centre": (0, 3), "right": (-8.032157, 20)},
    ),
    "j": (
        {"thickness": 20, "angle": 20, "root_face": 3, "root_radius": 6, "root_gap": 1, "mismatch": -1},
        {"left": (10.888740, 20), "root": (0, 3.5), "right": (-0.5, 21)},
    ),
    "lap": (
        {"thickness": 6, "upper_thickness": 4, "root_gap": 0.5},
        {"edge": (0, 10.5), "root": (0, 6)},
    ),
    "fillet": ({"thickness": 8, "upper_thickness": 6, "rise": 50}, {"root": (0, 8)}),
    "corner": (
        {"thickness": 8, "angle": 90, "root_face": 1, "rise": 50},
        {"left": (5.156854, 41.512193), "root": (0, 36.355339), "right": (-5.156854, 41.512193)},
    ),
}


def size_of(thickness, angle=60, corner_angle=90, **lengths):
    more = {f"{name}_m": 1e-3 * value for name, value in lengths.items()}
    angles = {"groove_angle_rad": angle * DEG, "corner_angle_rad": corner_angle * DEG}
    return JointSize(thickness_m=1e-3 * thickness, **angles, **more)


def section_of(kind, **changes):
    return joint_section(kind, size_of(**(JOINTS[kind][0] | changes)))


@pytest.mark.parametrize("kind", JOINTS)
def test_features_are_where_the_hand_puts_them(kind):
    found = section_of(kind).features
    expected = JOINTS[kind][1]
    assert list(found) == list(expected)
    for name, place in expected.items():
        np.testing.assert_allclose(1e3 * found[name], place, atol=EXACT_MM)


def test_rounded_bottom_is_level_at_the_root_and_tangent_to_the_wall():
    """Its points lie on the circle about (0, 9) mm; the last one is the tangent point; chords stray by 2 um at most."""
    edge = 1e3 * section_of("u").members[0].edge
    bottom = edge[1:-1]
    np.testing.assert_allclose(np.hypot(bottom[:, 0], bottom[:, 1] - 9), 6, atol=EXACT_MM)
    np.testing.assert_allclose(bottom[[0, -1]], [(0, 3), (5.908847, 7.958111)], atol=EXACT_MM)
    middles = (bottom[1:] + bottom[:-1]) / 2
    assert 6 - np.hypot(middles[:, 0], middles[:, 1] - 9).min() < 2e-3
    assert np.arctan2(*(edge[-1] - edge[-2])) == pytest.approx(10 * DEG, abs=1e-12)


def test_corner_without_root_face_is_two_square_cut_plates():
    """At 90 deg with a 90 deg groove the walls are the plates' ends: as long as the plates are thick."""
    features = section_of("corner", root_face=0, root_gap=1).features
    wall = features["left"] - features["root"] - [0.5e-3, 0]
    np.testing.assert_allclose(1e3 * wall, [8 / np.sqrt(2), 8 / np.sqrt(2)], atol=EXACT_MM)


@pytest.mark.parametrize("corner_deg", [60, 90, 120])
def test_plates_of_a_corner_have_their_thickness_and_angle(corner_deg):
    left, right = (member.outline for member in section_of("corner", corner_angle=corner_deg, angle=50).members)
    foot, outer_foot, edge, _, inner = left
    outer = (edge - outer_foot) / np.linalg.norm(edge - outer_foot)
    assert abs(np.cross([*outer, 0], [*(foot - edge), 0])[2]) == pytest.approx(8e-3, abs=1e-12)
    assert np.linalg.norm(foot - inner) == pytest.approx(0.050, abs=1e-12)
    other_foot, other_inner = right[-1], right[0]
    cosine = (foot - inner) @ (other_foot - other_inner) / 0.050**2
    assert np.arccos(cosine) == pytest.approx(corner_deg * DEG, abs=1e-9)


@pytest.mark.parametrize("kind", JOINTS)
def test_outlines_turn_counter_clockwise_and_edges_run_upwards(kind):
    section = section_of(kind)
    outlines = [member.outline for member in section.members if isinstance(member, Bar)]
    for outline in [*outlines, section.tack.full, section.tack.seed]:
        x, z = outline.T
        assert np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z) > 0
    for member in section.members:
        if isinstance(member, PlateEdge):
            assert np.all(np.diff(member.edge[:, 1]) > -1e-12)


@pytest.mark.parametrize("kind", JOINTS)
def test_lowering_moves_everything_by_the_same(kind):
    section = section_of(kind)
    lowered = section.lowered(0.004)
    for name, place in section.features.items():
        np.testing.assert_allclose(place - lowered.features[name], [0, 0.004], atol=1e-15)
    np.testing.assert_allclose(section.tack.full - lowered.tack.full, np.tile([0, 0.004], (len(section.tack.full), 1)))
    for one, other in zip(section.members, lowered.members, strict=True):
        if isinstance(one, FullPlate):
            assert one.high_m - other.high_m == pytest.approx(0.004)
        else:
            key = "outline" if isinstance(one, Bar) else "edge"
            assert getattr(one, key)[0, 1] - getattr(other, key)[0, 1] == pytest.approx(0.004)


@pytest.mark.parametrize(
    ("kind", "changes", "words"),
    [
        ("x", {}, "Available: butt, v"),
        ("v", {"thickness": np.nan}, "finite"),
        ("v", {"root_gap": -1}, "not negative"),
        ("v", {"thickness": 0}, "positive"),
        ("v", {"angle": 180}, "0 to 180 deg"),
        ("bevel", {"angle": 90}, "0 to 90 deg"),
        ("v", {"root_face": 12}, "root face"),
        ("v", {"root_face": 0}, "falls apart"),
        ("v", {"mismatch": 2}, "falls apart"),
        ("v", {"mismatch": 20}, "mismatch_m"),
        ("v-gap", {"root_gap": 0}, "expected a gap"),
        ("butt", {"root_gap": 0}, "expected a gap"),
        ("u", {"root_radius": 0}, "root_radius_m"),
        ("u", {"root_radius": 21}, "root_radius_m"),
        ("lap", {"mismatch": 1}, "mismatch_m"),
        ("fillet", {"rise": 0}, "rise_m"),
        ("corner", {"corner_angle": 20}, "30 to 150 deg"),
        ("corner", {"rise": 5}, "longer than thick"),
    ],
)
def test_impossible_joints_are_refused(kind, changes, words):
    sizes = JOINTS.get(kind, JOINTS["v"])[0]
    with pytest.raises(BadGeometry, match=words):
        joint_section(kind, size_of(**(sizes | changes)))
