# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of what shader nodes give anywhere in a domain, without running them: interval arithmetic with a rate of change.

A colour counts as the interval of all its channels, a coordinate by its rate alone. What is not known is ANY. Keyframes and drivers
make a socket's value ANY, constant in space.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import bpy

from ..plan.observed import ANY, UNKNOWN, Range

UNIT = Range(0.0, 1.0)
MOST_NODES = 4096  # that are looked at for one socket: a tree that shares its nodes may have more ways through than nodes
# Nodes that give the same in all of a domain where their inputs do.
_PLAIN = {"ShaderNodeObjectInfo", "ShaderNodeLightPath", "ShaderNodeBlackbody", "ShaderNodeCombineColor", "ShaderNodeCombineXYZ",
          "ShaderNodeSeparateColor", "ShaderNodeSeparateXYZ", "ShaderNodeRGBToBW", "ShaderNodeRGBCurve", "ShaderNodeBrightContrast",
          "ShaderNodeHueSaturation", "ShaderNodeWavelength", "ShaderNodeGamma", "ShaderNodeVectorMath", "ShaderNodeFloatCurve",
          "ShaderNodeMapRange", "ShaderNodeMath", "ShaderNodeMix"}


@dataclass
class Reader:
    """Reads the sockets of one material on one object.

    ``size``: extents of its bounding box in the scene; ``scale``: of its axes; ``local`` and ``world``: its coordinates.
    """

    size: Sequence[float] = (1.0, 1.0, 1.0)
    scale: Sequence[float] = (1.0, 1.0, 1.0)
    local: Range = ANY
    world: Range = ANY
    looked_at: int = 0

    def of(self, socket: bpy.types.NodeSocket, stack: tuple = ()) -> Range:
        """Bounds of what an input socket gets; ``stack`` holds the group nodes that it is inside of, outermost first."""
        found, stack = source(socket, stack)
        if found is None:
            return default(socket)
        if not found.is_output:
            return default(found)
        return self._node(found, stack)

    def _node(self, output: bpy.types.NodeSocket, stack: tuple) -> Range:
        node = output.node
        self.looked_at += 1
        if self.looked_at > MOST_NODES:
            return UNKNOWN
        read = lambda key: self.of(_input(node, key), stack)  # noqa: E731
        known = _KNOWN.get(node.bl_idname)
        try:
            result = known(node, output, read, self) if known else None
        except (KeyError, StopIteration):  # a socket that this Blender names otherwise
            result = None
        if result is not None:
            return result
        constant = node.bl_idname in _PLAIN and all(self.of(socket, stack).rate == 0.0 for socket in node.inputs if socket.is_linked)
        return ANY if constant else UNKNOWN


def source(socket: bpy.types.NodeSocket, stack: tuple = ()) -> tuple[bpy.types.NodeSocket | None, tuple]:
    """What feeds an input, through reroutes and into and out of groups: an output, or the unlinked input whose value it takes.

    None where the value is the socket's own. The second is the stack of group nodes around it.
    """
    passed = False
    while socket.is_linked and socket.links and not socket.links[0].is_muted:
        node, output = socket.links[0].from_node, socket.links[0].from_socket
        if node.mute:
            return output, stack
        if node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.bl_idname == "NodeGroupInput" and stack:
            outer, stack = stack[-1], stack[:-1]
            socket = next(s for s in outer.inputs if s.identifier == output.identifier)
        elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            leave = next((n for n in node.node_tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output), None)
            if leave is None:
                return output, stack
            stack = (*stack, node)
            socket = next(s for s in leave.inputs if s.identifier == output.identifier)
        else:
            return output, stack
        passed = True
    return (socket if passed else None), stack


def default(socket: bpy.types.NodeSocket) -> Range:
    value = getattr(socket, "default_value", None)
    if value is None or isinstance(value, str) or _is_moved(socket):
        return ANY
    if isinstance(value, (int, float)):
        return Range(float(value), float(value))
    parts = tuple(value)[:3]
    return Range(min(parts), max(parts))


def is_animated(block: bpy.types.ID) -> bool:
    """Whether keyframes or drivers may move anything of the datablock."""
    data = block.animation_data
    return data is not None and (data.action is not None or len(data.drivers) > 0 or len(data.nla_tracks) > 0)


def _is_moved(socket: bpy.types.NodeSocket) -> bool:
    """Whether keyframes or drivers may move the value of a socket."""
    data = socket.id_data.animation_data
    if data is None or not is_animated(socket.id_data):
        return False
    if data.nla_tracks:
        return True
    curves = list(data.drivers)
    if data.action is not None:
        curves += [curve for layer in data.action.layers for strip in layer.strips for bag in strip.channelbags for curve in bag.fcurves]
    return any(curve.data_path.startswith(socket.path_from_id()) for curve in curves)


def _input(node: bpy.types.Node, key: str | int) -> bpy.types.NodeSocket:
    if isinstance(key, int):
        return node.inputs[key]
    return next(socket for socket in node.inputs if socket.name == key and socket.enabled)


# --- arithmetic --------------------------------------------------------------------------------------------------


def _size(a: Range) -> float:
    return max(abs(a.low), abs(a.high))


def _times(a: float, b: float) -> float:
    return 0.0 if a == 0.0 or b == 0.0 else a * b


def plus(a: Range, b: Range) -> Range:
    return Range(a.low + b.low, a.high + b.high, a.rate + b.rate)


def minus(a: Range, b: Range) -> Range:
    return Range(a.low - b.high, a.high - b.low, a.rate + b.rate)


def times(a: Range, b: Range) -> Range:
    ends = [_times(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    return Range(min(ends), max(ends), _times(_size(a), b.rate) + _times(_size(b), a.rate))


def over(a: Range, b: Range) -> Range:
    if b.low <= 0.0 <= b.high:
        return replace(ANY, rate=math.inf if a.rate or b.rate else 0.0)
    least = min(abs(b.low), abs(b.high))
    return times(a, Range(1.0 / b.high, 1.0 / b.low, _times(b.rate, 1.0 / least**2)))


def least(a: Range, b: Range) -> Range:
    return Range(min(a.low, b.low), min(a.high, b.high), max(a.rate, b.rate))


def most(a: Range, b: Range) -> Range:
    return Range(max(a.low, b.low), max(a.high, b.high), max(a.rate, b.rate))


def clamped(a: Range, low: Range = Range(0.0, 0.0), high: Range = Range(1.0, 1.0)) -> Range:
    return least(most(a, low), high)


def mixed(factor: Range, a: Range, b: Range) -> Range:
    """a + f (b - a), within the two where the factor is a share."""
    between = minus(b, a)
    result = plus(a, times(factor, between))
    if factor.low >= 0.0 and factor.high <= 1.0:
        low, high = min(a.low, b.low), max(a.high, b.high)
        if factor.is_constant and factor.low in (0.0, 1.0):
            return a if factor.low == 0.0 else b
        rate = max(a.rate, b.rate) + _times(factor.rate, _size(between))
        return Range(max(low, result.low) if math.isfinite(result.low) else low,
                     min(high, result.high) if math.isfinite(result.high) else high, rate)
    return result


def _jumping(a: Range, low: float, high: float) -> Range:
    return Range(low, high, math.inf if a.rate else 0.0)


def _power(a: Range, b: Range) -> Range:
    if a.low < 0.0 or not b.is_constant or not math.isfinite(a.high):
        return replace(ANY, rate=math.inf if a.rate or b.rate else 0.0)
    try:
        low, high = sorted((a.low**b.low, a.high**b.low))
        # A root is steep at 0, for a moment: it goes from end to end in the same distance as its argument.
        slope = high / a.high if 0.0 <= b.low < 1.0 and a.high > 0.0 else abs(b.low) * max(x ** (b.low - 1.0) for x in (a.low, a.high)) \
            if a.rate else 0.0
    except (OverflowError, ZeroDivisionError):
        return replace(ANY, rate=math.inf if a.rate else 0.0)
    return Range(low, high, _times(slope, a.rate))


def _exponential(a: Range) -> Range:
    high = math.exp(a.high) if a.high < 700.0 else math.inf
    return Range(math.exp(max(a.low, -745.0)), high, _times(high, a.rate))


def root(a: Range) -> Range:
    return _power(most(a, Range(0.0, 0.0)), Range(0.5, 0.5))


def _absolute(a: Range) -> Range:
    return Range(0.0 if a.low <= 0.0 <= a.high else min(abs(a.low), abs(a.high)), _size(a), a.rate)


_ONE = {
    "ABSOLUTE": _absolute, "EXPONENT": _exponential, "SQRT": root,
    "SINE": lambda a: Range(-1.0, 1.0, a.rate), "COSINE": lambda a: Range(-1.0, 1.0, a.rate),
    "SIGN": lambda a: _jumping(a, -1.0, 1.0), "FRACT": lambda a: _jumping(a, 0.0, 1.0),
    "FLOOR": lambda a: _jumping(a, a.low - 1.0, a.high), "CEIL": lambda a: _jumping(a, a.low, a.high + 1.0),
    "ROUND": lambda a: _jumping(a, a.low - 0.5, a.high + 0.5),
}
_TWO = {
    "ADD": plus, "SUBTRACT": minus, "MULTIPLY": times, "DIVIDE": over, "POWER": _power, "MINIMUM": least, "MAXIMUM": most,
    "GREATER_THAN": lambda a, b: _jumping(plus(a, b), 0.0, 1.0), "LESS_THAN": lambda a, b: _jumping(plus(a, b), 0.0, 1.0),
}


def _math(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    if node.operation in _ONE:
        result = _ONE[node.operation](read(0))
    elif node.operation in _TWO:
        result = _TWO[node.operation](read(0), read(1))
    elif node.operation == "MULTIPLY_ADD":
        result = plus(times(read(0), read(1)), read(2))
    else:
        return None
    return clamped(result) if node.use_clamp else result


def _map_range(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    if node.data_type != "FLOAT":
        return None
    value, low, high = read("Value"), read("To Min"), read("To Max")
    start, end = read("From Min"), read("From Max")
    share = over(minus(value, start), minus(end, start))
    match node.interpolation_type:
        case "LINEAR":
            share = clamped(share) if node.clamp else share
        case "SMOOTHSTEP" | "SMOOTHERSTEP":  # their slopes at the middle: 1.5 and 1.875
            share = replace(clamped(share), rate=1.875 * share.rate)
        case _:
            share = _jumping(share, 0.0, 1.0)
    return mixed(share, low, high)


def _mix(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    modern = node.bl_idname == "ShaderNodeMix"
    if modern and node.data_type not in ("FLOAT", "RGBA"):
        return None
    factor, a, b = map(read, ("Factor", "A", "B") if modern else (0, 1, 2))
    if not modern or node.clamp_factor:
        factor = clamped(factor)
    blend = node.blend_type if not modern or node.data_type == "RGBA" else "MIX"
    blends = {"MIX": lambda x, y: y, "ADD": plus, "MULTIPLY": times, "SUBTRACT": minus, "DARKEN": least, "LIGHTEN": most}
    if blend not in blends:
        return None
    result = mixed(factor, a, blends[blend](a, b))
    return clamped(result) if (node.clamp_result if modern else node.use_clamp) else result


def _ramp(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
    rate = read(0).rate
    ramp = node.color_ramp
    stops = sorted(((element.position, (element.color[3],) if output.name == "Alpha" else tuple(element.color[:3]))
                    for element in ramp.elements), key=lambda stop: stop[0])
    values = [part for _, parts in stops for part in parts]
    low, high = min(values), max(values)
    if ramp.interpolation == "CARDINAL":  # overshoots
        low, high = low - 0.2 * (high - low), high + 0.2 * (high - low)
    if rate == 0.0:
        return Range(low, high)
    if ramp.interpolation == "CONSTANT" and low < high:
        return Range(low, high, math.inf)
    steep = max((abs(y - x) / max(q - p, 1e-6) for (p, a), (q, b) in zip(stops, stops[1:]) for x, y in zip(a, b)), default=0.0)
    return Range(low, high, _times(rate, steep * (1.0 if ramp.interpolation == "LINEAR" else 1.5)))


def _clamp(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
    return clamped(read("Value"), read("Min"), read("Max"))


def _value(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
    return default(output)


def _invert(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
    color = read("Color")
    return mixed(clamped(read(0)), color, minus(Range(1.0, 1.0), color))


def _gray(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
    return read("Color")


# --- coordinates and textures ------------------------------------------------------------------------------------


def _coordinates(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    lengths = {"Generated": reader.size, "Object": reader.scale}.get(output.name)
    if lengths is None or (output.name == "Object" and node.object is not None) or min(map(abs, lengths)) == 0.0:
        return None
    return replace(reader.local if output.name == "Object" else UNIT, rate=1.0 / min(map(abs, lengths)))


def _geometry(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    return replace(reader.world, rate=1.0) if output.name == "Position" else None


def _mapping(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
    return replace(ANY, rate=_times(_place(node, read, reader), _size(read("Scale"))))


def _vector_math(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    a, b = read(0), read(1)
    match node.operation:
        case "ADD" | "SUBTRACT":
            return replace(ANY, rate=a.rate + b.rate)
        case "SCALE":
            return times(a, read("Scale")) if not math.isinf(_size(a)) else replace(ANY, rate=_times(a.rate, _size(read("Scale"))))
        case "MULTIPLY":
            return replace(ANY, rate=_times(a.rate, _size(b)) if b.rate == 0.0 else math.inf)
        case "LENGTH" | "DISTANCE":
            return Range(0.0, math.inf, a.rate + (b.rate if node.operation == "DISTANCE" else 0.0))
    return None


def _separated(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
    return read(0)


def _place(node: bpy.types.Node, read: Callable, reader: Reader) -> float:
    """Rate of a texture's coordinates: generated ones where nothing is linked."""
    socket = _input(node, "Vector")
    return read("Vector").rate if socket.is_linked else 1.0 / max(min(reader.size), 1e-30)


def _texture(low: float, high: float, periods: float = 1.0) -> Callable:
    """A texture within these bounds that goes once from one to the other in a period of its coordinates over its scale.

    Finer octaves are weaker by their roughness and are not counted.
    """
    def known(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range:
        scale = _size(read("Scale")) if "Scale" in node.inputs else 1.0
        rate = _times(_place(node, read, reader), scale) * periods * (high - low)
        distortion = node.inputs.get("Distortion")
        if distortion is not None and (distortion.is_linked or distortion.default_value != 0.0):
            rate = math.inf
        return Range(low, high, rate)

    return known


def _noise(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    """Normalised fractal noise is within [0, 1]; the bounds of the other kinds are unknown."""
    found = _texture(0.0, 1.0)(node, output, read, reader)
    return found if node.normalize and node.noise_type == "FBM" else replace(ANY, rate=found.rate)


def _voronoi(node: bpy.types.Node, output: bpy.types.NodeSocket, read: Callable, reader: Reader) -> Range | None:
    """The distance changes as the place does; no point in space is farther than the diagonal of a cell from the nearest one."""
    if output.name != "Distance" or node.feature not in ("F1", "SMOOTH_F1") or node.distance != "EUCLIDEAN":
        return None
    return _texture(0.0, 1.0 if node.normalize else math.sqrt(3.0))(node, output, read, reader)


_KNOWN: dict[str, Callable] = {
    "ShaderNodeValue": _value, "ShaderNodeRGB": _value, "ShaderNodeMath": _math, "ShaderNodeMapRange": _map_range,
    "ShaderNodeMix": _mix, "ShaderNodeMixRGB": _mix, "ShaderNodeValToRGB": _ramp, "ShaderNodeClamp": _clamp,
    "ShaderNodeInvert": _invert, "ShaderNodeRGBToBW": _gray, "ShaderNodeTexCoord": _coordinates, "ShaderNodeNewGeometry": _geometry,
    "ShaderNodeMapping": _mapping, "ShaderNodeVectorMath": _vector_math, "ShaderNodeSeparateXYZ": _separated,
    "ShaderNodeTexNoise": _noise, "ShaderNodeTexVoronoi": _voronoi, "ShaderNodeTexWave": _texture(0.0, 1.0, 20.0),
    "ShaderNodeTexGradient": _texture(0.0, 1.0),
}
