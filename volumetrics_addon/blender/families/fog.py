# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of height fog."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...scene.model import Shape
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import Outputs, Sockets, one_lobe


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    position = socket_of(build.node("ShaderNodeNewGeometry").outputs, "Position")
    depth = build.math("DIVIDE", build.math("SUBTRACT", inputs["base_height"], build.components(position)[2]),
                       inputs["scale_height"])
    extinction = build.math("MULTIPLY", inputs["extinction"], build.math("EXPONENT", depth))
    return one_lobe(build, inputs["albedo"], extinction, inputs["g"])
