# SPDX-License-Identifier: GPL-3.0-or-later
"""The patterns of scene.gobo as shader nodes, whose numbers are driven by the sockets of the item's own material.

One node group serves the light in Cycles and the masks in EEVEE. It evaluates a pattern where a ray passes, so that it is as
sharp as its softness says; the picture of a render on a stage is its mean over pixels. The noise is the engines' own, which
scene.noise equals; the cells of stained glass and a picture file are looked up in an image that repeats.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np

from ..parameters.families import FAMILIES
from ..scene import gobo, noise
from ..scene.model import Projector
from . import pictures
from .nodes import Tree, arrange, read_live, socket_of

Socket = bpy.types.NodeSocket
LIVE = ("gobo_softness", "gobo_scale", "gobo_rotation", "gobo_drift_right", "gobo_drift_up", "gobo_time")


def group(values: Mapping[str, Any], light: Projector, name: str, owner: bpy.types.Material,
          node: bpy.types.Node) -> bpy.types.NodeTree:
    """A group from the place (aspect u, v) in the frustum to the share of the light that passes, in colour.

    ``node`` of the material ``owner`` has the family's live parameters as sockets; they drive the group.
    """
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    tree.interface.new_socket("Place", in_out="INPUT", socket_type="NodeSocketVector")
    tree.interface.new_socket("Passed", in_out="OUTPUT", socket_type="NodeSocketColor")
    build = Tree(tree)
    live = {key: _driven(build, key, owner, node) for key in LIVE}
    place = _plane(build, build.node("NodeGroupInput").outputs[0], live)
    if values["gobo"] == "image":
        aspect = math.tan(light.horizontal_fov / 2.0) / math.tan(light.vertical_fov / 2.0)
        passed = _image(build, place, aspect, values, name)
    else:
        softness = build.math("MAXIMUM", live["gobo_softness"], gobo.SOFTEST)
        passed = _PATTERNS[values["gobo"]](build, build.scale(place, values["gobo_count"] / 2.0), softness, values["gobo_seed"],
                                           live["gobo_time"], name)
    build.feed(build.node("NodeGroupOutput").inputs[0], passed)
    arrange(tree)
    return tree


def _driven(build: Tree, key: str, owner: bpy.types.Material, node: bpy.types.Node) -> Socket:
    """A number that follows the socket of a live parameter: the plain average of one, which asks for no permission to run."""
    parameter = FAMILIES["godray"][key]
    result = build.node("ShaderNodeValue", label=parameter.label)
    result.name = key
    result.outputs[0].default_value = node.inputs[FAMILIES["godray"].live.index(parameter)].default_value
    driver = result.outputs[0].driver_add("default_value").driver
    driver.type = "AVERAGE"
    read_live(driver, key, owner, node, FAMILIES["godray"])
    return result.outputs[0]


def _plane(build: Tree, place: Socket, live: Mapping[str, Socket]) -> Socket:
    """R(-rotation) place / scale - time drift."""
    turned = build.node("ShaderNodeVectorRotate", {"Vector": place, "Angle": live["gobo_rotation"]}, rotation_type="Z_AXIS",
                        invert=True).outputs[0]
    drift = build.combine(live["gobo_drift_right"], live["gobo_drift_up"], 0.0)
    return build.vector("SUBTRACT", build.vector("DIVIDE", turned, live["gobo_scale"]), build.scale(drift, live["gobo_time"]))


def _ramp(build: Tree, x: Socket, softness: Any) -> Socket:
    """Smooth step from 0 to 1 around 0, of a number."""
    return build.node("ShaderNodeMapRange", {"Value": build.math("DIVIDE", x, softness), "From Min": -0.5, "From Max": 0.5},
                      interpolation_type="SMOOTHSTEP").outputs[0]


def _panes(build: Tree, place: Socket, half: float, softness: Socket) -> tuple[Socket, ...]:
    """1 within ``half`` of the middle of each unit cell, along each axis."""
    middle = build.vector("ABSOLUTE", build.vector("SUBTRACT", build.vector("FRACTION", place), (0.5,) * 3))
    edge = build.vector("DIVIDE", build.vector("SUBTRACT", (half,) * 3, middle), softness)
    ramp = build.node("ShaderNodeMapRange", {"Vector": edge, "From_Min_FLOAT3": (-0.5,) * 3, "From_Max_FLOAT3": (0.5,) * 3},
                      data_type="FLOAT_VECTOR", interpolation_type="SMOOTHSTEP")
    return build.components(socket_of(ramp.outputs, "Vector"))


def _window(build, place, softness, seed, time, name):
    x, y, _ = _panes(build, place, gobo.PANE, softness)
    return build.math("MULTIPLY", x, y)


def _blinds(build, place, softness, seed, time, name):
    return _panes(build, place, gobo.SLAT, softness)[1]


def _rising(build: Tree, place: Socket, rate: float, time: Socket) -> Socket:
    return build.vector("MULTIPLY_ADD", (0.0, 0.0, rate), time, place)


def _noise(build: Tree, place: Socket, rise: float, detail: float, seed: int) -> Socket:
    offset = noise.seed_offset(seed)
    return build.node("ShaderNodeTexNoise", {
        "Vector": build.vector("ADD", place, (offset[0], offset[1], offset[2] + rise)), "Scale": 1.0, "Detail": detail,
        "Roughness": 0.5, "Lacunarity": 2.0, "Distortion": 0.0,
    }, noise_dimensions="3D", noise_type="FBM", normalize=True).outputs[0]


def _leaves(build, place, softness, seed, time, name):
    value = _noise(build, _rising(build, place, gobo.LEAF_RATE, time), 0.0, gobo.LEAF_DETAIL, seed)
    return _ramp(build, build.math("SUBTRACT", value, gobo.LEAF_LEVEL), build.math("MULTIPLY", softness, gobo.LEAF_EDGE))


def _water(build, place, softness, seed, time, name):
    width = build.math("MULTIPLY_ADD", softness, gobo.WATER_SOFTER, gobo.WATER_LINE)
    place = _rising(build, place, gobo.WATER_RATE, time)
    total: Any = gobo.WATER_FLOOR
    for layer in range(gobo.WATER_LAYERS):
        value = _noise(build, place, gobo.WATER_STEP * layer, 0.0, seed + layer)
        line = build.math("DIVIDE", build.math("MULTIPLY_ADD", value, 2.0, -1.0), width)
        bright = build.math("POWER", math.exp(-1.0), build.math("MULTIPLY", line, line))
        total = build.math("MULTIPLY_ADD", bright, 1.0 / gobo.WATER_LAYERS, total, clamp=True)
    return total


def _stained_glass(build, place, softness, seed, time, name):
    """The nearest of nine points gives the colour, and the second nearest the lead between them.

    Squares of distances are kept as vectors, one for each column of cells, whose lanes are the cells below, here and above.
    """
    points, colors = gobo.cells(seed)
    share = 1.0 / gobo.PERIOD
    here = build.vector("MULTIPLY_ADD", build.vector("FLOOR", place), (share,) * 3, (0.5 * share, 0.5 * share, 0.0))
    columns = _columns(build, points, here, build.vector("FRACTION", place), name)
    rows, nearest, second = _two_least(build, *columns)
    between = build.math("MULTIPLY", build.math("ADD", nearest, second), 0.5)
    # Where the nearest is, the sign is -1, and 1 elsewhere.
    left, _, right = columns
    left, right, rows = (build.vector("SIGN", build.vector("SUBTRACT", squares, between)) for squares in (left, right, rows))
    aside = build.combine(build.scalar("DOT_PRODUCT", build.vector("SUBTRACT", left, right), (0.5 * share,) * 3),
                          build.scalar("DOT_PRODUCT", rows, (0.5 * share, 0.0, -0.5 * share)), 0.0)
    color = _looked_up(build, packed(f"{name} glass", colors), build.vector("ADD", here, aside))
    gap = build.math("SUBTRACT", build.math("SQRT", second), build.math("SQRT", nearest))
    return build.scale(color, _ramp(build, build.math("SUBTRACT", gap, gobo.LEAD), softness))


def _columns(build: Tree, points: np.ndarray, here: Socket, within: Socket, name: str) -> list[Socket]:
    """Squares of the distances to the points of three cells each, at the left, here and at the right."""
    share = 1.0 / gobo.PERIOD
    below_to_above = np.stack([np.roll(points, -step, axis=0) + (0.0, step) for step in (-1, 0, 1)], axis=-1)
    across, up = (packed(f"{name} cells {axis}", below_to_above[:, :, k]) for k, axis in enumerate("xy"))
    x, y, _ = build.components(within)
    result = []
    for step in (-1, 0, 1):
        cell = build.vector("ADD", here, (share * step, 0.0, 0.0)) if step else here
        dx = build.vector("SUBTRACT", _looked_up(build, across, cell), build.math("SUBTRACT", x, step) if step else x)
        dy = build.vector("SUBTRACT", _looked_up(build, up, cell), y)
        result.append(build.vector("MULTIPLY_ADD", dx, dx, build.vector("MULTIPLY", dy, dy)))
    return result


def _two_least(build: Tree, a: Socket, b: Socket, c: Socket) -> tuple[Socket, Socket, Socket]:
    """The least of three vectors in each lane, the least of all their numbers and the second least."""
    low, high = build.vector("MINIMUM", a, b), build.vector("MAXIMUM", a, b)
    lanes, others = build.vector("MINIMUM", low, c), build.vector("MINIMUM", high, build.vector("MAXIMUM", low, c))
    x, y, z = build.components(lanes)
    pairs = build.vector("MAXIMUM", lanes, build.combine(y, z, x))  # the least of these is the lanes' second least
    return lanes, build.math("MINIMUM", build.math("MINIMUM", x, y), z), build.least(build.vector("MINIMUM", others, pairs))


def _looked_up(build: Tree, image: bpy.types.Image, place: Socket) -> Socket:
    """The pixel of a cell, given by its middle as a share of the period."""
    node = build.node("ShaderNodeTexImage", {"Vector": place}, image=image, interpolation="Closest", extension="REPEAT")
    return socket_of(node.outputs, "Color")


def _image(build: Tree, place: Socket, aspect: float, values: Mapping[str, Any], name: str) -> Socket:
    """The file's picture at its resolution in the beam, bilinear between its pixels."""
    pixels = gobo.resampled(pictures.read("gobo_image", values["gobo_image"]), aspect=aspect,
                            resolution=values["gobo_resolution"])
    place = build.vector("MULTIPLY_ADD", place, (0.5 / aspect, 0.5, 0.0), (0.5, 0.5, 0.0))
    node = build.node("ShaderNodeTexImage", {"Vector": place}, image=packed(f"{name} picture", pixels[::-1]),
                      interpolation="Linear", extension="REPEAT")
    return socket_of(node.outputs, "Color")


def packed(name: str, rows: np.ndarray) -> bpy.types.Image:
    """A linear image in full precision of rows (m, n, 3) or (m, n) from below to above, packed into the file."""
    pixels = np.ones((*rows.shape[:2], 4), np.float32)
    pixels[..., :3] = rows if rows.ndim == 3 else rows[..., None]
    result = bpy.data.images.new(name, rows.shape[1], rows.shape[0], alpha=False, float_buffer=True, is_data=True)
    result.use_half_precision = False
    result.pixels.foreach_set(pixels.ravel())
    result.update()
    result.pack()
    return result


_PATTERNS = {"window": _window, "blinds": _blinds, "leaves": _leaves, "water": _water, "stained_glass": _stained_glass}
