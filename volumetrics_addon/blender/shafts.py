# SPDX-License-Identifier: GPL-3.0-or-later
"""Shafts of sunlight behind the faces of a mesh: haze in the light's own volume and nowhere else."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import bpy
import numpy as np

from ..parameters.families import FAMILIES
from ..scene.families.godray import shafts
from ..scene.families.item import Item
from ..scene.geometry import contains
from ..scene.model import Vector, add, normalized, scaled
from ..scene.openings import GRAZING, area, convex_parts, dot, is_convex, is_flat, middle, sine_of
from . import extract, items

LABEL = "Sun shafts"
MOST = 256  # shafts of one item: each is an object


def outlines(body: bpy.types.Object, only_selected: bool) -> tuple[list[tuple[int, ...]], list[Vector]]:
    """Convex polygons of the mesh, as indices of the points, and these in world space.

    Faces that are bent or not convex come as triangles.
    """
    data = body.data
    points = [tuple(body.matrix_world @ vertex.co) for vertex in data.vertices]
    data.calc_loop_triangles()
    triangles: dict[int, list[tuple[int, ...]]] = {}
    for triangle in data.loop_triangles:
        triangles.setdefault(triangle.polygon_index, []).append(tuple(triangle.vertices))
    found = []
    for polygon in data.polygons:
        if only_selected and not polygon.select:
            continue
        corners = [points[index] for index in polygon.vertices]
        if is_convex(corners) and is_flat(corners):
            found.append(tuple(polygon.vertices))
        else:
            found += triangles[polygon.index]
    return [outline for outline in found if math.hypot(*area([points[index] for index in outline])) > 0.0], points


def add_shafts(scene: bpy.types.Scene, body: bpy.types.Object, only_selected: bool,
               changes: Mapping[str, Any]) -> tuple[bpy.types.Collection, list[str]]:
    """A godray whose haze fills the light of the scene's sun behind the faces of a mesh, and warnings about what was left out.

    Neighbouring faces in one plane that make a convex outline become one shaft. ``changes`` are values of the family, such as
    where the shafts end. Raises ValueError without faces, without a sun, or where the sun reaches no face; then nothing has been
    added.
    """
    if body is None or body.type != "MESH":
        raise ValueError("shafts come through the faces of a mesh; make a mesh the active object and select faces of its "
                         "openings")
    direction = extract.sun(scene).direction
    faces, points = outlines(body, only_selected)
    if not faces:
        raise ValueError(f"no face of {body.name} is selected; select the faces of its openings in Edit Mode" if only_selected
                         else f"{body.name} has no faces; take a mesh whose faces are the openings")
    lit = [face for face in faces if sine_of([points[i] for i in face], direction) >= GRAZING]
    if not lit:
        raise ValueError(f"the sun shines along every chosen face of {body.name}; turn the sun or choose other faces")
    warnings = [f"{len(faces) - len(lit)} faces are left out: the sun shines along them"] if len(lit) < len(faces) else []
    parts = convex_parts(lit, points, direction)
    if len(parts) > MOST:
        raise ValueError(f"the faces make {len(parts)} shafts, at most {MOST} are allowed; choose the openings alone, with "
                         "fewer faces")
    values = FAMILIES["godray"].check(
        {"light": "sun", "irradiance": 0.0, "blocker": "none", **changes, **_opening(parts, direction)})
    volumes = shafts(values, parts, direction)
    first = [volume for part, volume in zip(parts, volumes) if not any(
        contains(other.domain, np.array([middle(part)]))[0] for other in volumes if other is not volume)]
    if len(first) < len(volumes):
        warnings.append(f"{len(volumes) - len(first)} shafts are left out: they begin in those of other faces")
    return items.place_item(scene, "godray", values, Item(first), LABEL), warnings


def _opening(parts: Sequence[Sequence[Vector]], direction: Vector) -> dict:
    """The rectangle around the largest of the openings, in the family's terms."""
    largest = max(parts, key=lambda part: math.hypot(*area(part)))
    normal, center = normalized(area(largest)), middle(largest)
    flat = math.hypot(normal[0], normal[1])
    azimuth, tilt = math.atan2(normal[0], normal[1]) if flat > 1e-6 else 0.0, math.atan2(-normal[2], flat)
    facing, right = (math.sin(azimuth), math.cos(azimuth), 0.0), (math.cos(azimuth), -math.sin(azimuth), 0.0)
    up = add(scaled((0.0, 0.0, 1.0), math.cos(tilt)), scaled(facing, math.sin(tilt)))
    spans = [[dot(corner, axis) for corner in largest] for axis in (right, up)]
    width, height = (max(1e-3, max(span) - min(span)) for span in spans)
    return {"location": center, "target": add(center, direction), "opening_width": width, "opening_height": height,
            "opening_azimuth": math.degrees(azimuth), "opening_tilt": math.degrees(tilt)}
