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
    x, y = _plane(build, build.components(build.node("NodeGroupInput").outputs[0]), live)
    if values["gobo"] == "image":
        aspect = math.tan(light.horizontal_fov / 2.0) / math.tan(light.vertical_fov / 2.0)
        passed = _image(build, x, y, aspect, values, name)
    else:
        half = values["gobo_count"] / 2.0
        softness = build.math("MAXIMUM", live["gobo_softness"], gobo.SOFTEST)
        passed = _PATTERNS[values["gobo"]](build, build.math("MULTIPLY", x, half), build.math("MULTIPLY", y, half), softness,
                                           values["gobo_seed"], live["gobo_time"], name)
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


def _plane(build: Tree, place: tuple[Socket, ...], live: Mapping[str, Socket]) -> tuple[Socket, Socket]:
    """R(-rotation) place / scale - time drift."""
    c, s = (build.math(operation, live["gobo_rotation"]) for operation in ("COSINE", "SINE"))
    u, v, _ = place
    turned = (build.math("ADD", build.math("MULTIPLY", c, u), build.math("MULTIPLY", s, v)),
              build.math("SUBTRACT", build.math("MULTIPLY", c, v), build.math("MULTIPLY", s, u)))
    return tuple(build.math("SUBTRACT", build.math("DIVIDE", along, live["gobo_scale"]),
                            build.math("MULTIPLY", live["gobo_time"], live[f"gobo_drift_{way}"]))
                 for along, way in zip(turned, ("right", "up")))


def _ramp(build: Tree, x: Socket, softness: Any) -> Socket:
    t = build.math("ADD", build.math("DIVIDE", x, softness), 0.5, clamp=True)
    return build.math("MULTIPLY", build.math("MULTIPLY", t, t), build.math("MULTIPLY_ADD", t, -2.0, 3.0))


def _pane(build: Tree, x: Socket, half: float, softness: Socket) -> Socket:
    middle = build.math("ABSOLUTE", build.math("SUBTRACT", build.math("SUBTRACT", x, build.math("FLOOR", x)), 0.5))
    return _ramp(build, build.math("SUBTRACT", half, middle), softness)


def _window(build, x, y, softness, seed, time, name):
    return build.math("MULTIPLY", _pane(build, x, gobo.PANE, softness), _pane(build, y, gobo.PANE, softness))


def _blinds(build, x, y, softness, seed, time, name):
    return _pane(build, y, gobo.SLAT, softness)


def _noise(build: Tree, x: Socket, y: Socket, z: Socket, detail: float, seed: int) -> Socket:
    place = build.vector("ADD", build.combine(x, y, z), tuple(noise.seed_offset(seed)))
    return build.node("ShaderNodeTexNoise", {
        "Vector": place, "Scale": 1.0, "Detail": detail, "Roughness": 0.5, "Lacunarity": 2.0, "Distortion": 0.0,
    }, noise_dimensions="3D", noise_type="FBM", normalize=True).outputs[0]


def _leaves(build, x, y, softness, seed, time, name):
    value = _noise(build, x, y, build.math("MULTIPLY", time, gobo.LEAF_RATE), gobo.LEAF_DETAIL, seed)
    return _ramp(build, build.math("SUBTRACT", value, gobo.LEAF_LEVEL), build.math("MULTIPLY", softness, gobo.LEAF_EDGE))


def _water(build, x, y, softness, seed, time, name):
    width = build.math("MULTIPLY_ADD", softness, gobo.WATER_SOFTER, gobo.WATER_LINE)
    total: Any = gobo.WATER_FLOOR
    for layer in range(gobo.WATER_LAYERS):
        rise = build.math("MULTIPLY_ADD", time, gobo.WATER_RATE, gobo.WATER_STEP * layer)
        line = build.math("DIVIDE", build.math("MULTIPLY_ADD", _noise(build, x, y, rise, 0.0, seed + layer), 2.0, -1.0), width)
        bright = build.math("EXPONENT", build.math("MULTIPLY", build.math("MULTIPLY", line, line), -1.0))
        total = build.math("MULTIPLY_ADD", bright, 1.0 / gobo.WATER_LAYERS, total, clamp=True)
    return total


def _stained_glass(build, x, y, softness, seed, time, name):
    points, colors = gobo.cells(seed)
    table, glass = (packed(f"{name} {what}", pixels) for what, pixels in (
        ("cells", np.concatenate([points, np.zeros((*points.shape[:2], 1))], axis=-1)), ("glass", colors)))

    def looked_up(image: bpy.types.Image, cell: Socket) -> Socket:
        share = 1.0 / gobo.PERIOD
        place = build.vector("MULTIPLY_ADD", cell, (share, share, share), (0.5 * share, 0.5 * share, 0.0))
        node = build.node("ShaderNodeTexImage", {"Vector": place}, image=image, interpolation="Closest", extension="REPEAT")
        return socket_of(node.outputs, "Color")

    here = build.combine(x, y, 0.0)
    own = build.vector("FLOOR", here)
    first, second, nearest = None, None, None
    for di in (-1.0, 0.0, 1.0):
        for dj in (-1.0, 0.0, 1.0):
            cell = build.vector("ADD", own, (di, dj, 0.0))
            distance = build.scalar("DISTANCE", build.vector("ADD", cell, looked_up(table, cell)), here)
            if first is None:
                first, second, nearest = distance, 1e9, cell
                continue
            nearer = build.math("LESS_THAN", distance, first)
            second = build.math("MINIMUM", build.math("MAXIMUM", first, distance), second)
            nearest = build.vector("MULTIPLY_ADD", build.vector("SUBTRACT", cell, nearest), nearer, nearest)
            first = build.math("MINIMUM", first, distance)
    lead = build.math("SUBTRACT", build.math("SUBTRACT", second, first), gobo.LEAD)
    return build.scale(looked_up(glass, nearest), _ramp(build, lead, softness))


def _image(build: Tree, x: Socket, y: Socket, aspect: float, values: Mapping[str, Any], name: str) -> Socket:
    """The file's picture at its resolution in the beam, bilinear between its pixels."""
    pixels = gobo.resampled(pictures.read("gobo_image", values["gobo_image"]), aspect=aspect,
                            resolution=values["gobo_resolution"])
    place = build.combine(build.math("MULTIPLY_ADD", x, 0.5 / aspect, 0.5), build.math("MULTIPLY_ADD", y, 0.5, 0.5), 0.0)
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
