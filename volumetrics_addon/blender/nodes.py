# SPDX-License-Identifier: GPL-3.0-or-later
"""Typed helpers to write a shader node tree as an expression."""

from __future__ import annotations

import math
from typing import Any

import bpy

from ..parameters.model import Group, Parameter

_SOCKETS = {"float": "NodeSocketFloat", "int": "NodeSocketInt", "bool": "NodeSocketBool",
            "color": "NodeSocketColor", "vector": "NodeSocketVector"}
_SUBTYPES = {"m": "DISTANCE", "m/s": "VELOCITY", "deg": "ANGLE"}


class Tree:
    """A node tree under construction. Values passed to nodes are sockets (linked) or constants (set)."""

    def __init__(self, tree: bpy.types.NodeTree):
        self.tree = tree

    def node(self, kind: str, inputs: dict[str | int, Any] | None = None, **properties: Any) -> bpy.types.Node:
        """A new node with properties and inputs set; inputs are addressed by identifier or index, never by label."""
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            if getattr(node, name) != value:  # Blender goes through the whole tree after every assignment
                setattr(node, name, value)
        for key, value in (inputs or {}).items():
            self.feed(socket_of(node.inputs, key), value)
        return node

    def feed(self, socket: bpy.types.NodeSocket, value: Any) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif socket.type == "VECTOR" and isinstance(value, (int, float)):
            socket.default_value = (value,) * 3  # as a link would
        else:
            socket.default_value = value

    def math(self, operation: str, *operands: Any, clamp: bool = False) -> bpy.types.NodeSocket:
        node = self.node("ShaderNodeMath", dict(enumerate(operands)), operation=operation, use_clamp=clamp)
        return node.outputs[0]

    def vector(self, operation: str, *operands: Any) -> bpy.types.NodeSocket:
        """Vector result of a vector operation."""
        node = self.node("ShaderNodeVectorMath", dict(enumerate(operands)), operation=operation)
        return socket_of(node.outputs, "Vector")

    def scale(self, vector: Any, factor: Any) -> bpy.types.NodeSocket:
        node = self.node("ShaderNodeVectorMath", {0: vector, "Scale": factor}, operation="SCALE")
        return socket_of(node.outputs, "Vector")

    def scalar(self, operation: str, *operands: Any) -> bpy.types.NodeSocket:
        """Scalar result (LENGTH, DOT_PRODUCT, DISTANCE) of a vector operation."""
        node = self.node("ShaderNodeVectorMath", dict(enumerate(operands)), operation=operation)
        return socket_of(node.outputs, "Value")

    def components(self, vector: Any) -> tuple[bpy.types.NodeSocket, ...]:
        return tuple(self.node("ShaderNodeSeparateXYZ", {0: vector}).outputs)

    def combine(self, x: Any, y: Any, z: Any) -> bpy.types.NodeSocket:
        return self.node("ShaderNodeCombineXYZ", {0: x, 1: y, 2: z}).outputs[0]

    def least(self, vector: Any) -> bpy.types.NodeSocket:
        """The least component."""
        x, y, z = self.components(vector)
        return self.math("MINIMUM", self.math("MINIMUM", x, y), z)

    def shader_sum(self, *shaders: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        total = shaders[0]
        for shader in shaders[1:]:
            total = self.node("ShaderNodeAddShader", {0: total, 1: shader}).outputs[0]
        return total


def socket_of(sockets: Any, key: str | int) -> bpy.types.NodeSocket:
    if isinstance(key, int):
        return sockets[key]
    for socket in sockets:
        if socket.identifier == key:
            return socket
    raise KeyError(f"no socket {key!r} among {[socket.identifier for socket in sockets]}")


def add_input(tree: bpy.types.NodeTree, parameter: Parameter) -> None:
    """An input socket of a node group, from the parameter's declaration."""
    socket = tree.interface.new_socket(parameter.label, description=parameter.description, in_out="INPUT",
                                       socket_type=_SOCKETS[parameter.kind])
    if parameter.kind in ("float", "int", "vector"):
        if parameter.unit in _SUBTYPES:
            socket.subtype = _SUBTYPES[parameter.unit]
        number = int if parameter.kind == "int" else float
        if parameter.minimum is not None:
            socket.min_value = number(parameter.minimum * socket_factor(parameter))
        if parameter.maximum is not None:
            socket.max_value = number(parameter.maximum * socket_factor(parameter))
    socket.default_value = socket_value(parameter, parameter.default)


def socket_value(parameter: Parameter, value: Any) -> Any:
    """A checked value as a socket takes it: colours get an alpha, angles are in radians."""
    if parameter.kind == "color":
        return (*value, 1.0)
    return value * socket_factor(parameter) if parameter.unit == "deg" else value


def read_live(driver: bpy.types.Driver, key: str, owner: bpy.types.Material, node: bpy.types.Node, family: Group) -> None:
    """A variable of the driver, named after the live parameter whose socket on the family's ``node`` it follows."""
    variable = driver.variables.new()
    variable.name, variable.type = key, "SINGLE_PROP"
    target = variable.targets[0]
    target.id_type, target.id = "MATERIAL", owner
    index = family.live.index(family[key])
    target.data_path = f'node_tree.nodes["{bpy.utils.escape_identifier(node.name)}"].inputs[{index}].default_value'


def socket_factor(parameter: Parameter) -> float:
    """What a socket holds for one of the declared unit."""
    return math.radians(1.0) if parameter.unit == "deg" else 1.0


def prune(tree: bpy.types.NodeTree) -> None:
    """Remove the nodes that no output is reached from."""
    reached, waiting = set(), [node for node in tree.nodes if not node.outputs]
    while waiting:
        node = waiting.pop()
        if node not in reached:
            reached.add(node)
            waiting += [link.from_node for socket in node.inputs for link in socket.links]
    for node in [node for node in tree.nodes if node not in reached]:
        tree.nodes.remove(node)


def arrange(tree: bpy.types.NodeTree, step: tuple[float, float] = (200.0, 170.0)) -> None:
    """Place nodes in columns by their distance to the outputs, so that a reader of the tree can follow it."""
    index = {node: i for i, node in enumerate(tree.nodes)}
    links = [(index[link.from_node], index[link.to_node]) for link in tree.links]
    rank = [0] * len(index)
    for _ in index:
        moved = False
        for start, end in links:
            if rank[start] <= rank[end]:
                rank[start] = rank[end] + 1
                moved = True
        if not moved:
            break
    filled: dict[int, int] = {}
    places = []
    for column in rank:
        row = filled.get(column, 0)
        filled[column] = row + 1
        places += (-step[0] * column, -step[1] * row)
    tree.nodes.foreach_set("location", places)  # all at once: Blender goes through the whole tree after every assignment
