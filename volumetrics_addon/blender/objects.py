# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene shapes, lights, surfaces and cameras as Blender objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from ..plan.model import BLACK_PROBE
from ..scene.model import (
    Box, Camera, Color, Cone, Ellipsoid, Hull, Light, Shape, Sun, Surface, add, look_frame, normalized, scaled, subtract,
)
from .compat import use_nodes
from .nodes import Tree, arrange, socket_of

SPHERE_SUBDIVISIONS = 6
NEAR_GROUND = 0.01  # of the radii: 64 km above the Earth
RING_GROWTH = 0.05  # of the angle from ring to ring, and of the way around in each
FIRST_RING = 1e-5  # rad: 64 m on the Earth, where the ground falls by 0.3 mm
CONE_SIDES = 128


def _frame(axes: tuple, center: tuple) -> Matrix:
    """Matrix with the axes as columns and the centre as translation."""
    result = Matrix(axes).transposed().to_4x4()
    result.translation = center
    return result


def mesh(shape: Shape, name: str, eye: tuple[float, float, float] | None = None) -> tuple[bpy.types.Mesh, Matrix]:
    """A closed mesh in metres around its own origin, and its placement in the world.

    An ellipsoid with the ``eye`` so near to it that facets of equal size would show is meshed as rings around the nearest
    point, which is then the mesh's origin.
    """
    if eye is not None and isinstance(shape, Ellipsoid) and is_ground(shape, eye):
        return rings(shape, eye, name)
    data = bpy.data.meshes.new(name)
    if isinstance(shape, Ellipsoid):
        _fill(data, *_ellipsoid(shape))
        return data, placement(shape)
    build = bmesh.new()
    match shape:
        case Box():
            flat = [axis for axis in range(3) if shape.half[axis] == 0.0]
            if flat:
                across = [axis for axis in range(3) if axis != flat[0]]
                corners = []
                for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                    corner = [0.0, 0.0, 0.0]
                    corner[across[0]], corner[across[1]] = u * shape.half[across[0]], v * shape.half[across[1]]
                    corners.append(build.verts.new(corner))
                build.faces.new(corners)
            else:
                bmesh.ops.create_cube(build, size=2.0, matrix=Matrix.Diagonal((*shape.half, 1.0)))
        case Cone():
            radius = shape.length * math.tan(shape.half_angle)
            tip = build.verts.new((0.0, 0.0, 0.0))
            ring = [build.verts.new((radius * math.cos(a), radius * math.sin(a), -shape.length))
                    for a in (2.0 * math.pi * i / CONE_SIDES for i in range(CONE_SIDES))]
            for i, vertex in enumerate(ring):
                build.faces.new((tip, vertex, ring[(i + 1) % CONE_SIDES]))
            build.faces.new(list(reversed(ring)))
        case Hull():
            vertices = [build.verts.new(subtract(corner, shape.corners[0])) for corner in shape.corners]
            for face in shape.faces:
                build.faces.new([vertices[index] for index in face])
    build.normal_update()
    build.to_mesh(data)
    build.free()
    return data, placement(shape)


def placement(shape: Shape) -> Matrix:
    """Where the shape's mesh is placed in the world."""
    if isinstance(shape, Cone):
        return _frame(look_frame(shape.axis), shape.apex)
    if isinstance(shape, Hull):
        return Matrix.Translation(shape.corners[0])
    return _frame(shape.axes, shape.center)


def is_ground(shape: Ellipsoid, eye: tuple[float, float, float]) -> bool:
    """Whether the eye is nearer to the ellipsoid than ten thousandths of its radii."""
    return abs(math.hypot(*_unit_sphere(shape, eye)) - 1.0) < NEAR_GROUND


def _unit_sphere(shape: Ellipsoid, point: tuple[float, float, float]) -> tuple[float, float, float]:
    """The point where the ellipsoid is the unit sphere around the origin."""
    offset = subtract(point, shape.center)
    return tuple(sum(o * a for o, a in zip(offset, axis)) / half for axis, half in zip(shape.axes, shape.half))


def rings(shape: Ellipsoid, eye: tuple[float, float, float], name: str) -> tuple[bpy.types.Mesh, Matrix]:
    """An ellipsoid as rings around the point next to the eye, whose angles grow geometrically.

    A facet at the distance d is as long as RING_GROWTH d and lies (RING_GROWTH d)^2 / (8 R) below the ball of radius R: on
    the Earth 0.06 m at the horizon of a 100 m tower, where a subdivided icosahedron lies 200 m below everywhere. Vertices
    are counted from that point, sin and 1 - cos of the angles in closed form, so that float32 is exact near the eye. They
    lie on the ellipsoid, so that an eye above it is above the mesh.
    """
    pole = normalized(_unit_sphere(shape, eye))
    east, north, _ = look_frame(scaled(pole, -1.0))
    angles = [FIRST_RING]
    while angles[-1] * (1.0 + RING_GROWTH) < math.pi:
        angles.append(angles[-1] * (1.0 + RING_GROWTH))

    angle = np.array(angles)[:, None]
    sides = math.ceil(2.0 * math.pi / RING_GROWTH)
    turn = 2.0 * math.pi * np.arange(sides) / sides
    across, drop = np.sin(angle), np.broadcast_to(-2.0 * np.sin(angle / 2.0) ** 2, (len(angles), sides))
    points = sum(np.multiply.outer(part, axis) for part, axis in (
        (across * np.cos(turn), east), (across * np.sin(turn), north), (drop, pole)))
    far = -2.0 * np.array(pole)  # opposite the pole
    vertices = np.concatenate([np.zeros((1, 3)), points.reshape(-1, 3), far[None]]) * shape.half

    i = np.arange(sides)
    j = (i + 1) % sides
    first, last, end = 1, 1 + sides * (len(angles) - 1), len(vertices) - 1
    low = np.arange(first, last, sides)[:, None]
    quads = np.stack([low + i, low + sides + i, low + sides + j, low + j], axis=-1)
    data = bpy.data.meshes.new(name)
    _fill(data, vertices, [np.stack([np.zeros_like(i), first + i, first + j], axis=-1), quads.reshape(-1, 4),
                           np.stack([last + i, np.full_like(i, end), last + j], axis=-1)])
    origin = add(shape.center, tuple(sum(p * h * axis[i] for p, h, axis in zip(pole, shape.half, shape.axes)) for i in range(3)))
    return data, _frame(shape.axes, origin)


def _fill(data: bpy.types.Mesh, vertices: np.ndarray, faces: Sequence[np.ndarray]) -> None:
    """Give an empty mesh its vertices (n, 3) and faces, arrays of as many corners each, which are smooth as new ones are.

    Attributes are copied as they lie in memory; "co" and "vertex_index" are set one by one, a hundred times as slow.
    """
    data.vertices.add(len(vertices))
    data.attributes["position"].data.foreach_set("vector", np.asarray(vertices, np.float32).ravel())
    corners = np.concatenate([array.ravel() for array in faces]).astype(np.int32)
    sides = np.concatenate([np.full(len(array), array.shape[1]) for array in faces])
    data.loops.add(len(corners))
    data.attributes[".corner_vert"].data.foreach_set("value", corners)
    data.polygons.add(len(sides))
    data.polygons.foreach_set("loop_start", (np.cumsum(sides) - sides).astype(np.int32))
    data.update(calc_edges=True)


def _triangles(data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and corners (m, 3) of a mesh of triangles."""
    vertices, corners = np.empty(3 * len(data.vertices), np.float32), np.empty(len(data.loops), np.int32)
    data.vertices.foreach_get("co", vertices)
    data.loops.foreach_get("vertex_index", corners)
    return vertices.reshape(-1, 3), corners.reshape(-1, 3)


@lru_cache(maxsize=1)
def _unit_sphere_mesh() -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices (n, 3) and triangles of a subdivided icosahedron, and the factor that gives it the volume of the unit ball."""
    build = bmesh.new()
    bmesh.ops.create_icosphere(build, subdivisions=SPHERE_SUBDIVISIONS, radius=1.0)
    swell = (4.0 * math.pi / 3.0 / build.calc_volume()) ** (1.0 / 3.0)
    data = bpy.data.meshes.new("sphere")
    build.to_mesh(data)
    build.free()
    vertices, triangles = _triangles(data)
    bpy.data.meshes.remove(data)
    return vertices, triangles, swell


def _ellipsoid(shape: Ellipsoid) -> tuple[np.ndarray, list[np.ndarray]]:
    """Vertices and faces. The facets lie inside the ellipsoid; equal volume makes the mean chord right."""
    vertices, triangles, swell = _unit_sphere_mesh()
    return vertices * np.array(shape.half, np.float32) * np.float32(swell), [triangles]


def shell(outer: Ellipsoid, cavity: Ellipsoid, name: str) -> tuple[bpy.types.Mesh, Matrix]:
    """As ``mesh``, of a wall: one mesh bounds it on both sides, and the normals of the inner one point into the cavity."""
    data = bpy.data.meshes.new(name)
    (outside, (faces,)), (inside, _) = map(_ellipsoid, (outer, cavity))
    _fill(data, np.concatenate([outside, inside]), [faces, faces[:, ::-1] + len(outside)])
    return data, placement(outer)


def body(shape: Shape, name: str, material: bpy.types.Material, collection: bpy.types.Collection,
         eye: tuple[float, float, float] | None = None, cavity: Ellipsoid | None = None) -> bpy.types.Object:
    data, where = shell(shape, cavity, name) if cavity is not None else mesh(shape, name, eye)
    data.materials.append(material)
    result = bpy.data.objects.new(name, data)
    result.matrix_world = where
    collection.objects.link(result)
    return result


def light(source: Light, name: str, collection: bpy.types.Collection, axes: tuple | None = None) -> bpy.types.Object:
    """A light object with the Scene's radiometry (see the table of conventions in scene.model), turned to ``axes`` if given."""
    colour = source.irradiance if isinstance(source, Sun) else source.power
    strength = max(colour)
    kind = {"Sun": "SUN", "Point": "POINT", "Spot": "SPOT"}[type(source).__name__]
    data = bpy.data.lights.new(name, kind)
    data.energy = strength
    data.color = tuple(c / strength for c in colour) if strength > 0.0 else (1.0, 1.0, 1.0)
    data.use_shadow = True
    if kind == "SUN":
        data.angle = 0.0
    else:
        data.shadow_soft_size = 0.0
    if kind == "SPOT":
        data.spot_size, data.spot_blend = source.cone_angle, source.blend
    data.cycles.max_bounces = 1024
    result = bpy.data.objects.new(name, data)
    position = (0.0, 0.0, 0.0) if kind == "SUN" else source.position
    direction = (0.0, 0.0, -1.0) if kind == "POINT" else source.direction
    result.matrix_world = _frame(axes or look_frame(direction), position)
    collection.objects.link(result)
    return result


def surface_material(surface: Surface, name: str) -> bpy.types.Material:
    result = bpy.data.materials.new(name)
    build = Tree(use_nodes(result))
    shaders = []
    if max(surface.albedo) > 0.0 or max(surface.emission) == 0.0:
        shaders.append(build.node("ShaderNodeBsdfDiffuse", {"Color": (*surface.albedo, 1.0), "Roughness": 0.0}).outputs[0])
    if max(surface.emission) > 0.0:
        shaders.append(_emission(build, "ShaderNodeEmission", surface.emission))
    output = build.node("ShaderNodeOutputMaterial", target="ALL")
    build.feed(socket_of(output.inputs, "Surface"), build.shader_sum(*shaders))
    arrange(build.tree)
    return result


def _emission(build: Tree, kind: str, radiance: Color) -> bpy.types.NodeSocket:
    """Colour sockets are limited in the UI to 1, so the brightest channel goes to the strength."""
    strength = max(radiance)
    color = tuple(c / strength for c in radiance) if strength > 0.0 else (0.0, 0.0, 0.0)
    return build.node(kind, {"Color": (*color, 1.0), "Strength": strength}).outputs[0]


def world(radiance: Color, name: str, share: Color = (1.0, 1.0, 1.0)) -> bpy.types.World:
    """Uniform environment, and never a volume. With a ``share`` it is seen as it is, and shines with that share of its light."""
    result = bpy.data.worlds.new(name)
    # EEVEE takes what is brighter than a threshold for a sun, of a uniform world too, and draws shadow maps even where it finds none.
    result.sun_threshold, result.use_sun_shadow = 0.0, False
    if not any(radiance):
        result.probe_resolution = str(BLACK_PROBE)
    build = Tree(use_nodes(result))
    output = build.node("ShaderNodeOutputWorld", target="ALL")
    seen = _emission(build, "ShaderNodeBackground", radiance)
    if share != (1.0, 1.0, 1.0):
        shining = _emission(build, "ShaderNodeBackground", tuple(r * s for r, s in zip(radiance, share)))
        camera_ray = socket_of(build.node("ShaderNodeLightPath").outputs, "Is Camera Ray")
        seen = build.node("ShaderNodeMixShader", {0: camera_ray, 1: shining, 2: seen}).outputs[0]
    build.feed(socket_of(output.inputs, "Surface"), seen)
    arrange(build.tree)
    return result


def camera(source: Camera, clip: tuple[float, float], name: str, collection: bpy.types.Collection) -> bpy.types.Object:
    data = bpy.data.cameras.new(name)
    data.type, data.sensor_fit = "PERSP", "HORIZONTAL"
    data.angle_x = source.field_of_view
    data.clip_start, data.clip_end = clip
    data.dof.use_dof = False
    result = bpy.data.objects.new(name, data)
    result.matrix_world = _frame(look_frame(source.direction), source.position)
    collection.objects.link(result)
    return result
