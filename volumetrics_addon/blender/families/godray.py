# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of the haze in a beam."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...scene.model import Shape
from ..fields import Fields
from ..nodes import Tree
from ..shaders import Outputs, Sockets, one_lobe


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    return one_lobe(build, inputs["albedo"], inputs["extinction"], inputs["g"])
