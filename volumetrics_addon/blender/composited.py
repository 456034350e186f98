# SPDX-License-Identifier: GPL-3.0-or-later
"""What node groups of the compositor share: what they know of camera and suns, the ray of each pixel, arithmetic.

The first inputs of a group are its family's live parameters, then the frame. The same nodes serve 4.5 and 5.x: those of the shaders
work in compositor trees of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import bpy

from ..parameters.model import Group
from .nodes import Tree, add_input, arrange, socket_of

Socket = Any

# Inputs of the group beside the live parameters: name, kind, description.
FRAME = (
    ("Image", "NodeSocketColor", "Picture without the fog."),
    ("Depth", "NodeSocketFloat", "Distance along the camera's axis."),
    ("Camera location", "NodeSocketVector", "Position of the camera."),
    ("Camera right", "NodeSocketVector", "Axis of the camera to the right."),
    ("Camera up", "NodeSocketVector", "Axis of the camera upwards."),
    ("Camera back", "NodeSocketVector", "Axis of the camera away from what it sees."),
    ("Picture", "NodeSocketVector", "Half its width and half its height one metre before the camera, and the side of a lens shift of 1."),
    ("Lens shift", "NodeSocketVector", "Shift of the picture to the right and upwards."),
    ("Farthest depth", "NodeSocketFloat", "From this depth on there is nothing but the background."),
    ("Sky radiance", "NodeSocketVector", "Radiance of the uniform environment."),
)
SUN = (("direction", "Direction in which the sun's light travels."), ("irradiance", "Irradiance facing the sun, in mW/m2."))
MILLI = 1e-3  # Blender rounds what a driver gives to 0 below 1e-4


class View(NamedTuple):
    """The ray of each pixel: from where, unit direction and its upward part, whether it meets anything, and how far from there."""

    origin: Socket
    direction: Socket
    mu: Socket
    hit: Socket
    distance: Socket


NOTHING = 1e9  # distance (m) of the background


def tree_of(family: Group, suns: int, name: str, picture: Callable[[Tree, Mapping[str, Socket]], Socket]) -> bpy.types.NodeTree:
    """A node group with the family's live parameters and the frame as inputs, and what ``picture`` makes of them as output."""
    tree = bpy.data.node_groups.new(name, "CompositorNodeTree")
    for parameter in family.live:
        add_input(tree, parameter)
    for label, kind, description in frame(suns):
        tree.interface.new_socket(label, description=description, in_out="INPUT", socket_type=kind)
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    build = Tree(tree)
    entry = build.node("NodeGroupInput")
    inputs = {parameter.name: socket for parameter, socket in zip(family.live, entry.outputs)}
    inputs |= {socket.name: socket for socket in entry.outputs[len(family.live):]}
    build.feed(build.node("NodeGroupOutput").inputs[0], picture(build, inputs))
    arrange(tree)
    return tree


def frame(suns: int) -> list[tuple[str, str, str]]:
    """FRAME and the inputs of each sun: label, socket type, description."""
    return [*FRAME, *((f"Sun {index + 1} {part}", "NodeSocketVector", text) for index in range(suns) for part, text in SUN)]


def sun_of(build: Tree, inputs: Mapping[str, Socket], index: int) -> tuple[Socket, Socket]:
    """Direction of travel and irradiance (W/m2) of a sun, counted from 0."""
    travel, irradiance = (inputs[f"Sun {index + 1} {part}"] for part, _ in SUN)
    return travel, build.scale(irradiance, MILLI)


def view_of(build: Tree, inputs: Mapping[str, Socket]) -> View:
    coordinates = socket_of(build.node("CompositorNodeImageCoordinates", {0: inputs["Image"]}).outputs, "Normalized")
    half_width, half_height, side = build.components(inputs["Picture"])
    u, v, _ = (build.math("MULTIPLY_ADD", c, 2.0, -1.0) for c in build.components(coordinates))
    right, up = (build.math("MULTIPLY_ADD", c, half, build.math("MULTIPLY", shift, side)) for c, half, shift in
                 zip((u, v), (half_width, half_height), build.components(inputs["Lens shift"])))
    across = build.vector("ADD", build.scale(inputs["Camera right"], right), build.scale(inputs["Camera up"], up))
    ray = build.vector("SUBTRACT", across, inputs["Camera back"])
    direction = build.vector("NORMALIZE", ray)
    hit = build.math("LESS_THAN", inputs["Depth"], inputs["Farthest depth"])
    distance = build.math("MULTIPLY", build.math("MINIMUM", inputs["Depth"], NOTHING), build.scalar("LENGTH", ray))
    return View(inputs["Camera location"], direction, build.components(direction)[2], hit, choose(build, hit, distance, NOTHING))


def with_alpha(build: Tree, image: Socket, color: Socket, passed: Socket) -> Socket:
    """The colour with the image's alpha, of whose gaps the share that is not ``passed`` is filled."""
    alpha = build.node("CompositorNodeSeparateColor", {0: image}).outputs[3]
    alpha = build.math("SUBTRACT", 1.0, build.math("MULTIPLY", build.math("SUBTRACT", 1.0, alpha), passed))
    return build.node("CompositorNodeCombineColor", {**dict(enumerate(build.components(color))), 3: alpha}).outputs[0]


def total(build: Tree, parts: Sequence[Socket]) -> Socket:
    result = parts[0]
    for part in parts[1:]:
        result = build.math("ADD", result, part)
    return result


def choose(build: Tree, condition: Socket, yes: Socket, no: Socket) -> Socket:
    """``yes`` where the condition is 1, ``no`` where it is 0; both finite. A difference of both would lose the smaller."""
    return build.math("MULTIPLY_ADD", condition, yes, build.math("MULTIPLY", build.math("SUBTRACT", 1.0, condition), no))


def henyey_greenstein(build: Tree, g: Socket, cosine: Socket) -> Socket:
    """(1 - g^2) / (4 pi ((1 - g)^2 + 2 g (1 - cos))^(3/2))."""
    away = build.math("SUBTRACT", 1.0, g)
    base = build.math("ADD", build.math("MULTIPLY", away, away),
                      build.math("MULTIPLY", build.math("MULTIPLY", g, 2.0), build.math("SUBTRACT", 1.0, cosine)))
    above = build.math("MULTIPLY", build.math("MULTIPLY", away, build.math("ADD", g, 1.0)), 1.0 / (4.0 * math.pi))
    return build.math("DIVIDE", above, build.math("POWER", build.math("MAXIMUM", base, 1e-12), 1.5))


def vector_sum(build: Tree, vectors: Sequence[Socket]) -> Socket:
    result = vectors[0]
    for vector in vectors[1:]:
        result = build.vector("ADD", result, vector)
    return result
