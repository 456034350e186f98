# SPDX-License-Identifier: GPL-3.0-or-later
"""How far light goes inside a closed mesh, measured by rays, for EEVEE.

EEVEE loses a volume inside a refracting surface, so the way through the body is stored on the mesh, at each corner of each face.
It depends on the direction, here linearly: d(omega) = alpha + gamma cos + tau . omega for the refracted ray omega at the inner
cosine cos = -n . omega, tau across the normal n. That is exact for a ball (d = 2 R cos) and within 2 % for a slab. The numbers are
the least-squares fit over rays of equal weight, evenly spread as light of a uniform sky would come in: uniform in the squared sine
below 1 / ior^2, by Snell's law. A ray's length is all of its way inside, also in a far wall behind a cavity; it is not bent
where it leaves and enters again. Modifiers that make faces (Solidify) hand the numbers on; with the normal apart they fit both
sides of a plate.

Rays do not start at the corners but at the points from which a linear interpolation has the right mean over the face.

The attributes hold alpha / s, gamma / s and M^T tau / s^2, with M the object's matrix and s its scale when they were measured.
Nodes bring in the scale of the moment, so an object that is later moved, turned or scaled evenly stays right.
"""

from __future__ import annotations

import math

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

from .interface import DIAGONAL, object_scale
from .nodes import Tree, socket_of

LENGTH, SLOPE, SKEW = "volumetrics_chord", "volumetrics_chord_slope", "volumetrics_chord_skew"
RAYS, FEWEST, MOST = 1_000_000, 6, 24  # for a mesh, and for each corner
MOST_WALLS = 16
TRIANGLE_POINTS, QUAD_POINTS = 0.5, 3.0**-0.5  # of the way from the face's centre to its corner: points of Gauss' quadrature


def scale_of(matrix: Matrix) -> float:
    """Length of an object's diagonal of length 1."""
    return (matrix.to_3x3() @ Vector(DIAGONAL)).length


def refuse_open(target: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
    """Raises ValueError unless the evaluated mesh bounds a volume: with the number of edges at fault, or for inward normals."""
    build = bmesh.new()
    build.from_object(target, depsgraph)
    try:
        if not build.faces:
            raise ValueError(f"{target.name} has no faces; take a mesh with a surface")
        total = len(build.edges)
        counts = {"have only one face": sum(len(edge.link_faces) == 1 for edge in build.edges),
                  "have no face": sum(not edge.link_faces for edge in build.edges),
                  "have more than two faces": sum(len(edge.link_faces) > 2 for edge in build.edges)}
        faults = [f"{count} of its {total} edges {what}" for what, count in counts.items() if count]
        if faults:
            raise ValueError(f"{target.name} is not watertight: {', '.join(faults)}; close it (Mesh > Clean Up > Fill Holes), "
                             "give it a Solidify modifier, or take a thin pane")
        turned = sum(not edge.is_contiguous for edge in build.edges)
        if turned:
            raise ValueError(f"the faces of {target.name} disagree about outside at {turned} of its {total} edges; recalculate "
                             "the normals (Mesh > Normals > Recalculate Outside)")
        if build.calc_volume(signed=True) * target.matrix_world.determinant() <= 0.0:
            raise ValueError(f"the normals of {target.name} point inwards, or it is flat; recalculate them (Mesh > Normals > "
                             "Recalculate Outside)")
    finally:
        build.free()


def measure(target: bpy.types.Object, ior: float, depsgraph: bpy.types.Depsgraph) -> int:
    """Store the ways through the evaluated mesh on the object's own mesh; returns the number of rays."""
    mesh, matrix = target.data, target.matrix_world
    tree = BVHTree.FromObject(target, depsgraph)
    origins, normals = _corners(mesh)
    if len(target.evaluated_get(depsgraph).data.polygons) != len(mesh.polygons):  # modifiers have moved the surface
        found = [tree.find_nearest(Vector(origin)) for origin in origins]
        origins, normals = np.array([f[0] for f in found]), np.array([f[1] for f in found])
    count = min(MOST, max(FEWEST, RAYS // max(1, len(origins))))
    local = _directions(count, ior)
    linear = np.array(matrix.to_3x3())
    inverse = np.linalg.inv(linear)
    outward = normals @ inverse  # normals go by the inverse transposed
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-30)
    frames = _frames(outward)
    lengths = np.empty((len(origins), count))
    step = 1e-6 * max(target.evaluated_get(depsgraph).dimensions) / max(scale_of(matrix), 1e-30)
    for k in range(count):
        world = np.einsum("nij,i->nj", frames, local[k])
        inward = world @ inverse.T
        stretch = np.linalg.norm(inward, axis=1)
        lengths[:, k] = [_inside(tree, Vector(o), Vector(d), step) for o, d in zip(origins, inward / stretch[:, None])]
        lengths[:, k] /= stretch  # a local unit along this direction is 1 / stretch in the world
    fit = lengths @ np.linalg.pinv(np.column_stack([np.ones(count), -local[:, 2], local[:, :2]])).T
    tau = np.einsum("nij,ni->nj", frames[:, :2], fit[:, 2:])
    scale = scale_of(matrix)
    _store(mesh, LENGTH, "FLOAT", "value", fit[:, 0] / scale)
    _store(mesh, SLOPE, "FLOAT", "value", fit[:, 1] / scale)
    _store(mesh, SKEW, "FLOAT_VECTOR", "vector", tau @ linear / scale**2)
    return lengths.size


def forget(mesh: bpy.types.Mesh) -> None:
    """Remove the attributes."""
    for name in (LENGTH, SLOPE, SKEW):
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])


def chord(build: Tree, back: bpy.types.NodeSocket, cosine: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """The way inside at the inner cosine, from the direction against the refracted ray in the object's coordinates."""
    scale = object_scale(build)
    alpha, gamma = (socket_of(build.node("ShaderNodeAttribute", attribute_name=name).outputs, "Fac") for name in (LENGTH, SLOPE))
    tau = socket_of(build.node("ShaderNodeAttribute", attribute_name=SKEW).outputs, "Vector")
    skew = build.math("MULTIPLY", build.scalar("DOT_PRODUCT", tau, back), scale)
    total = build.math("SUBTRACT", build.math("MULTIPLY_ADD", gamma, cosine, alpha), skew)
    return build.math("MAXIMUM", build.math("MULTIPLY", total, scale), 0.0)


def _corners(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Where the rays of each corner start, and its normal, in the object's coordinates."""
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    vertex = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex)
    normals = np.empty(3 * len(mesh.loops), np.float32)
    mesh.corner_normals.foreach_get("vector", normals)
    sides = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", sides)
    first = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_start", first)
    corners = positions.reshape(-1, 3).astype(float)[vertex]
    centers = np.add.reduceat(corners, first, axis=0) / sides[:, None]
    share = np.where(sides == 3, TRIANGLE_POINTS, QUAD_POINTS)
    face = np.repeat(np.arange(len(sides)), sides)
    return centers[face] + share[face][:, None] * (corners - centers[face]), normals.reshape(-1, 3).astype(float)


def _directions(count: int, ior: float) -> np.ndarray:
    """Refracted directions (count, 3) about -z, evenly spread over squared sines below 1 / ior^2, on a golden spiral."""
    sine2 = (np.arange(count) + 0.5) / count / ior**2
    turn = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    return np.column_stack([np.sqrt(sine2) * np.cos(turn), np.sqrt(sine2) * np.sin(turn), -np.sqrt(1.0 - sine2)])


def _frames(normal: np.ndarray) -> np.ndarray:
    """Rows (n, 3, 3): two tangents and the normal."""
    helper = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    tangent = np.cross(normal, helper)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-30)
    return np.stack([tangent, np.cross(normal, tangent), normal], axis=1)


def _inside(tree: BVHTree, origin: Vector, direction: Vector, step: float) -> float:
    """Length of the part of a ray inside, from a point on the surface inwards."""
    total, entered, travelled = 0.0, 0.0, step
    for _ in range(MOST_WALLS):
        _, normal, _, distance = tree.ray_cast(origin + direction * travelled, direction)
        if normal is None:
            break
        travelled += distance
        if normal.dot(direction) > 0.0:
            if entered is not None:
                total += travelled - entered
            entered = None
        elif entered is None:
            entered = travelled
        travelled += step
    return total


def _store(mesh: bpy.types.Mesh, name: str, kind: str, field: str, values: np.ndarray) -> None:
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, "CORNER")
    attribute.data.foreach_set(field, np.ascontiguousarray(values, np.float32).ravel())
    mesh.update()
