# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups: one builder per family, the source of truth for both engines.

Every group has the family's live parameters as inputs. Its outputs are one shader per engine: ``Cycles Volume`` and
``EEVEE Volume``, and where the family has a surface ``Cycles Surface``, ``EEVEE Surface`` and ``EEVEE Thickness``. EEVEE knows one
Henyey-Greenstein lobe per froxel and adds the g of added scatter nodes, so it gets a single lobe with the mean cosine.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from ..parameters.model import Group
from ..scene.model import Ellipsoid, Shape
from .compat import use_nodes
from .families import BUILDERS
from .fields import Fields
from .nodes import Tree, add_input, arrange, prune, socket_of, socket_value
from .shaders import ENGINES


def group(family: Group, values: Mapping[str, Any], shape: Shape, name: str, fields: Fields = Fields()) -> bpy.types.NodeTree:
    """The node group of a family for these build-time values; live values are set on the node that uses it."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for parameter in family.live:
        add_input(tree, parameter)
    build = Tree(tree)
    entry = build.node("NodeGroupInput")
    inputs = {parameter.name: entry.outputs[index] for index, parameter in enumerate(family.live)}
    outputs = BUILDERS[family.name](build, inputs, values, shape, fields)
    for label, socket in outputs.items():
        kind = "NodeSocketShader" if socket.type == "SHADER" else "NodeSocketFloat"
        tree.interface.new_socket(label, in_out="OUTPUT", socket_type=kind)
    leave = build.node("NodeGroupOutput")
    for index, shader in enumerate(outputs.values()):
        build.feed(leave.inputs[index], shader)
    if fields.glow:  # what EEVEE would have scattered
        prune(tree)
    arrange(tree)
    return tree


def material(family: Group, values: Mapping[str, Any], shape: Shape, name: str,
             fields: Fields = Fields()) -> bpy.types.Material:
    """A material with the family's group and one Material Output per engine."""
    result = bpy.data.materials.new(name)
    build = Tree(use_nodes(result))
    node = build.node("ShaderNodeGroup", node_tree=group(family, values, shape, name, fields))
    node.width = 240
    for index, parameter in enumerate(family.live):
        node.inputs[index].default_value = socket_value(parameter, values[parameter.name])
    for prefix, target in ENGINES.items():
        output = build.node("ShaderNodeOutputMaterial", target=target)
        for socket in node.outputs:
            if socket.name.startswith(prefix):
                build.feed(socket_of(output.inputs, socket.name.removeprefix(prefix + " ")), socket)
    made = {socket.name for socket in node.outputs}
    if "EEVEE Surface" in made and "EEVEE Thickness" not in made:
        result.surface_render_method = "BLENDED"
    elif "EEVEE Surface" in made:
        result.surface_render_method = "DITHERED"
        result.use_raytrace_refraction = True
        # Through the walls of a shell light goes on in its direction, as through a slab.
        result.thickness_mode = "SPHERE" if isinstance(shape, Ellipsoid) and fields.cavity is None else "SLAB"
    arrange(build.tree)
    return result
