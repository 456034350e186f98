# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays as native volumes, without OpenVDB: a mesh carries the voxels, Geometry Nodes turn them into a sparse grid.

The array is a point attribute of the object's mesh. The node Volume Cube evaluates its Density field on a lattice of
``resolution`` points that spans [Min, Max], both ends included; each point of the lattice is the centre of a voxel of the
grid, in both engines and in Blender 4.5 and 5.2. Centres of an array over the box [low, high] with cells of size h are
therefore reached with Min = low + h / 2, Max = high - h / 2 and no further shift. Measured on random voxels, transmittance
averaged over orthogonal rays, against the exact trilinear integral: Cycles -2e-6 (4.5) and +1e-4 (5.2), EEVEE -1e-4 to
-7e-4; shifted by half a voxel the pictures differ by 0.15.

Between the centres the engines interpolate trilinearly, and beyond the outermost ones towards the background 0 (Cycles) or
not at all (EEVEE), where ``scene.model.Grid`` stays constant up to its faces. An array that is not 0 on its outermost layer is
therefore continued by one more layer, and the material cuts it at the domain (``cut``). Voxels that are 0 stay inactive and
take no memory in the engines.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..reference.path_scene import bounding_box
from ..scene.model import IDENTITY, Box, Ellipsoid, Grid, Shape, Vector, Volume
from .nodes import Tree, arrange, socket_of

ATTRIBUTE = "density"  # of the mesh, and the name that Volume Cube gives its grid


def needs_cut(volume: Volume) -> bool:
    """Whether the voxels reach beyond the domain, or are not 0 at their own faces: then the material cuts them."""
    density = volume.medium.density
    values = np.asarray(density.values)
    faces = [np.take(values, index, axis) for axis in range(3) for index in (0, -1)]
    if any(face.any() for face in faces):
        return True
    low, high = bounding_box(volume.domain)
    return not isinstance(volume.domain, Box) or bool((low > density.low).any() or (high < density.high).any())


def body(volume: Volume, name: str, material: bpy.types.Material, collection: bpy.types.Collection) -> bpy.types.Object:
    """An object whose evaluated geometry is the volume's grid, with its origin in the middle of the domain.

    Raises ValueError where the domain is not a box along the axes or an ellipsoid.
    """
    if not isinstance(volume.domain, (Box, Ellipsoid)) or volume.domain.axes != IDENTITY:
        raise ValueError(f"voxels need a box or an ellipsoid along the axes as their domain, got {volume.domain}; "
                         "set what lies outside of the domain to 0 and take such a box")
    density = volume.medium.density
    values = np.asarray(density.values, np.float32)
    low, high = np.array(density.low), np.array(density.high)
    cell = (high - low) / values.shape
    if needs_cut(volume):
        values = np.pad(values, 1, mode="edge")
        low, high = low - cell, high + cell
    if 1 in values.shape:  # a lattice of one point has no spacing
        raise ValueError(f"voxels need at least two layers along every axis, got {values.shape}; repeat the only one")
    center = np.array(volume.domain.center)
    data = bpy.data.meshes.new(name)
    data.vertices.add(values.size)
    data.attributes.new(ATTRIBUTE, "FLOAT", "POINT").data.foreach_set("value", values.ravel())
    data.materials.append(material)
    result = bpy.data.objects.new(name, data)
    result.location = volume.domain.center
    result.modifiers.new(name, "NODES").node_group = _to_volume(
        values.shape, tuple(low + cell / 2 - center), tuple(high - cell / 2 - center), material, name)
    collection.objects.link(result)
    return result


def _to_volume(shape: tuple[int, int, int], first: Vector, last: Vector, material: bpy.types.Material,
               name: str) -> bpy.types.NodeTree:
    """Geometry nodes that place value (i ny + j) nz + k of the mesh at first + (i, j, k) (last - first) / (shape - 1)."""
    tree = bpy.data.node_groups.new(f"{name} voxels", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    build = Tree(tree)
    entry = build.node("NodeGroupInput")
    spacing = tuple((b - a) / (n - 1) for a, b, n in zip(first, last, shape))
    position = build.node("GeometryNodeInputPosition").outputs[0]
    place = build.components(build.vector("DIVIDE", build.vector("SUBTRACT", position, first), spacing))
    i, j, k = (build.node("FunctionNodeFloatToInt", {0: part}, rounding_mode="ROUND").outputs[0] for part in place)

    def whole(operation: str, a: bpy.types.NodeSocket, b: bpy.types.NodeSocket | int) -> bpy.types.NodeSocket:
        return build.node("FunctionNodeIntegerMath", {0: a, 1: b}, operation=operation).outputs[0]

    index = whole("ADD", whole("MULTIPLY", whole("ADD", whole("MULTIPLY", i, shape[1]), j), shape[2]), k)
    attribute = build.node("GeometryNodeInputNamedAttribute", {"Name": ATTRIBUTE}, data_type="FLOAT")
    sample = build.node("GeometryNodeSampleIndex", {"Geometry": entry.outputs[0], "Index": index}, data_type="FLOAT",
                        domain="POINT")
    build.feed(_float_socket(sample.inputs), _float_socket(attribute.outputs))
    cube = build.node("GeometryNodeVolumeCube", {
        "Density": _float_socket(sample.outputs), "Background": 0.0, "Min": first, "Max": last,
        "Resolution X": shape[0], "Resolution Y": shape[1], "Resolution Z": shape[2]})
    shaded = build.node("GeometryNodeSetMaterial", {"Geometry": cube.outputs[0], "Material": material})
    build.feed(build.node("NodeGroupOutput").inputs[0], shaded.outputs[0])
    arrange(tree)
    return tree


def _float_socket(sockets: bpy.types.bpy_prop_collection) -> bpy.types.NodeSocket:
    """The number among sockets of which a node shows the one that fits its data type."""
    return next(socket for socket in sockets if socket.enabled and socket.type == "VALUE")


def voxels(build: Tree, shape: Shape, cut: bool) -> bpy.types.NodeSocket:
    """The density of the grid in a material; with ``cut``, 0 outside of the domain, a box or ellipsoid around the origin."""
    density = socket_of(build.node("ShaderNodeAttribute", attribute_name=ATTRIBUTE, attribute_type="GEOMETRY").outputs, "Fac")
    if not cut:
        return density
    position = socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
    place = build.vector("DIVIDE", position, shape.half)
    if isinstance(shape, Ellipsoid):
        distance = build.scalar("LENGTH", place)
    else:
        x, y, z = build.components(build.vector("ABSOLUTE", place))
        distance = build.math("MAXIMUM", build.math("MAXIMUM", x, y), z)
    return build.math("MULTIPLY", density, build.math("LESS_THAN", distance, 1.0))
