"""Flat faces triangulated anew: the same surface with the same borders, in triangles that are no needles."""

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, Manifold

from weldcell.models.flat_faces import well_shaped
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSize
from weldcell.models.seam_path import SPath
from weldcell.models.swept_joint import joint_part


def mesh_of(solid):
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts.astype(np.int64), process=False)


def plate(turn_deg):
    """A plate of 200 x 100 x 10 mm with a round hole of 30 mm, drawn with 600 sides, turned in space."""
    outline = CrossSection.square((0.2, 0.1)) - CrossSection.circle(0.03, 600).translate((0.08, 0.05))
    return mesh_of(Manifold.extrude(outline, 0.01).rotate((0.4 * turn_deg, turn_deg, -2 * turn_deg)))


def creases(mesh):
    """Edges between faces that are not of one plane, as sorted points."""
    sharp = mesh.face_adjacency_edges[mesh.face_adjacency_angles > 1e-6]
    return np.unique(np.sort(np.round(mesh.vertices[sharp], 12), axis=1).reshape(-1, 6), axis=0)


def sides_m(mesh):
    """The longest side of each triangle that lies flat and up."""
    flat = mesh.face_normals[:, 2] > 1 - 1e-9
    corners = mesh.triangles[flat]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)


@pytest.mark.parametrize("turn_deg", [0.0, 31.0])
def test_the_surface_stays_what_it_was(turn_deg):
    old = plate(turn_deg)
    new = trimesh.Trimesh(*well_shaped(old.vertices, old.faces), process=False)
    assert new.is_watertight and new.is_winding_consistent and new.body_count == 1
    assert new.euler_number == old.euler_number == 0  # the hole is still one
    assert new.volume == pytest.approx(old.volume, rel=1e-12) and new.area == pytest.approx(old.area, rel=1e-12)
    np.testing.assert_allclose(new.bounds, old.bounds, atol=1e-15)
    np.testing.assert_array_equal(creases(new), creases(old))


def test_needles_are_gone_for_few_more_triangles():
    old = plate(0.0)
    new = trimesh.Trimesh(*well_shaped(old.vertices, old.faces), process=False)
    assert np.median(sides_m(old)) > 0.04  # from the hole to the plate's corners
    assert np.median(sides_m(new)) < 0.013  # m: the first grid begins within 1.2 + sqrt 2 spacings of 5 mm
    assert len(new.faces) < 1.5 * len(old.faces)


def test_curved_walls_and_small_faces_keep_their_triangles():
    ball, box = mesh_of(Manifold.sphere(0.05, 200)), mesh_of(Manifold.cube((0.1, 0.2, 0.3)))
    for mesh in (ball, box):
        vertices, faces = well_shaped(mesh.vertices, mesh.faces)
        np.testing.assert_array_equal(vertices[faces], mesh.triangles)


def test_plates_of_joints_have_no_needles():
    """A groove's edge of 600 points was joined to two corners 150 mm away."""
    size = JointSize(thickness_m=0.012, root_face_m=0.002)
    part = joint_part(joint_section("v", size), SPath(length_m=0.3, amplitude_m=0.03), 0.16, spacing_m=0.5e-3)
    assert np.median(sides_m(part.mesh_part())) < 0.02
