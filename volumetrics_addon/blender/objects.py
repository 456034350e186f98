# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene shapes, lights, surfaces and cameras as Blender objects."""

from __future__ import annotations

import math

import bmesh
import bpy
from mathutils import Matrix, Vector

from ..scene.model import Box, Camera, Color, Cone, Ellipsoid, Light, Shape, Sun, Surface, look_frame
from .compat import use_nodes
from .nodes import Tree, arrange, socket_of

SPHERE_SUBDIVISIONS = 6
CONE_SIDES = 128


def _frame(axes: tuple, center: tuple) -> Matrix:
    """Matrix with the axes as columns and the centre as translation."""
    result = Matrix(axes).transposed().to_4x4()
    result.translation = center
    return result


def mesh(shape: Shape, name: str) -> tuple[bpy.types.Mesh, Matrix]:
    """A closed mesh in metres around its own origin, and its placement in the world."""
    data = bpy.data.meshes.new(name)
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
        case Ellipsoid():
            bmesh.ops.create_icosphere(build, subdivisions=SPHERE_SUBDIVISIONS, radius=1.0)
            # The facets lie inside the sphere; equal volume makes the mean chord right.
            swell = (4.0 * math.pi / 3.0 / build.calc_volume()) ** (1.0 / 3.0)
            bmesh.ops.scale(build, vec=Vector(shape.half) * swell, verts=build.verts)
            for face in build.faces:
                face.smooth = True
        case Cone():
            radius = shape.length * math.tan(shape.half_angle)
            tip = build.verts.new((0.0, 0.0, 0.0))
            ring = [build.verts.new((radius * math.cos(a), radius * math.sin(a), -shape.length))
                    for a in (2.0 * math.pi * i / CONE_SIDES for i in range(CONE_SIDES))]
            for i, vertex in enumerate(ring):
                build.faces.new((tip, vertex, ring[(i + 1) % CONE_SIDES]))
            build.faces.new(list(reversed(ring)))
    build.normal_update()
    build.to_mesh(data)
    build.free()
    return data, placement(shape)


def placement(shape: Shape) -> Matrix:
    """Where the shape's mesh is placed in the world."""
    if isinstance(shape, Cone):
        return _frame(look_frame(shape.axis), shape.apex)
    return _frame(shape.axes, shape.center)


def body(shape: Shape, name: str, material: bpy.types.Material, collection: bpy.types.Collection) -> bpy.types.Object:
    data, where = mesh(shape, name)
    data.materials.append(material)
    result = bpy.data.objects.new(name, data)
    result.matrix_world = where
    collection.objects.link(result)
    return result


def light(source: Light, name: str, collection: bpy.types.Collection) -> bpy.types.Object:
    """A light object with the Scene's radiometry (see the table of conventions in scene.model)."""
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
    result.matrix_world = _frame(look_frame(direction), position)
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


def world(radiance: Color, name: str) -> bpy.types.World:
    """Uniform environment, and never a volume."""
    result = bpy.data.worlds.new(name)
    build = Tree(use_nodes(result))
    output = build.node("ShaderNodeOutputWorld", target="ALL")
    build.feed(socket_of(output.inputs, "Surface"), _emission(build, "ShaderNodeBackground", radiance))
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
