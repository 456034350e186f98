# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of shapes: closed, of the right volume, and outside in where they bound a cavity."""

import math
from collections import Counter

import bpy
import numpy as np
import pytest

from volumetrics_addon.blender import objects
from volumetrics_addon.scene.model import Box, Cone, Ellipsoid

HALF = (2.0, 0.5, 3.0)
VOLUMES = [
    (Ellipsoid((1.0, 2.0, 3.0), HALF), 4.0 / 3.0 * math.pi * math.prod(HALF)),
    (Box((0.0, 0.0, 0.0), HALF), 8.0 * math.prod(HALF)),
    (Cone((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 0.5, 3.0), objects.CONE_SIDES / 2.0 * math.sin(2.0 * math.pi / objects.CONE_SIDES)
     * (3.0 * math.tan(0.5)) ** 2 * 3.0 / 3.0),  # a pyramid over a polygon
]


def enclosed(mesh):
    """Volume inside the mesh, positive where the normals point out: tetrahedra from the origin to each triangle."""
    points = np.array([vertex.co for vertex in mesh.vertices], float)
    mesh.calc_loop_triangles()
    a, b, c = (points[[triangle.vertices[k] for triangle in mesh.loop_triangles]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0


def edges(mesh):
    return Counter(tuple(sorted(key)) for polygon in mesh.polygons for key in polygon.edge_keys)


@pytest.mark.parametrize(("shape", "volume"), VOLUMES, ids=lambda value: type(value).__name__)
def test_a_mesh_is_closed_and_of_the_shape_s_volume(shape, volume):
    mesh, _ = objects.mesh(shape, "shape")
    assert enclosed(mesh) == pytest.approx(volume, rel=2e-6)  # float32 vertices
    assert set(edges(mesh).values()) == {2} and len(mesh.edges) == len(edges(mesh))
    assert not mesh.validate()
    assert all(polygon.use_smooth for polygon in mesh.polygons) == isinstance(shape, Ellipsoid)
    bpy.data.meshes.remove(mesh)


def test_two_spheres_share_no_data():
    before = set(bpy.data.meshes)
    one, _ = objects.mesh(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), "one")
    two, _ = objects.mesh(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 2.0)), "two")
    assert {one, two} == set(bpy.data.meshes) - before
    tops = [max(vertex.co.z for vertex in mesh.vertices) for mesh in (one, two)]
    assert tops[1] == pytest.approx(2.0 * tops[0], rel=1e-6)
    for mesh in (one, two):
        bpy.data.meshes.remove(mesh)


def test_a_cavity_is_bounded_from_inside():
    outer, inner = Ellipsoid((0.0, 0.0, 0.0), HALF), Ellipsoid((0.0, 0.0, 0.0), tuple(0.5 * half for half in HALF))
    mesh, _ = objects.shell(outer, inner, "shell")
    assert enclosed(mesh) == pytest.approx((1.0 - 0.125) * 4.0 / 3.0 * math.pi * math.prod(HALF), rel=2e-6)
    assert set(edges(mesh).values()) == {2}
    bpy.data.meshes.remove(mesh)
