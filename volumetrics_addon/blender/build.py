# SPDX-License-Identifier: GPL-3.0-or-later
"""From a Scene to a Blender scene of its own, and away again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import bpy

from ..plan.model import CYCLES, Plan
from ..reference.light_grid import LightGrid
from ..scene.model import Box, Cone, Ellipsoid, Grid, Scene, Shape, Sun, Volume
from . import compat, grid, groups, light, objects, settings
from .nodes import Tree, socket_of

_COLLECTIONS = ("objects", "meshes", "lights", "cameras", "materials", "node_groups", "worlds", "scenes", "collections", "images")


@contextmanager
def temporary() -> Iterator[None]:
    """Whatever is made inside is removed at the end: no datablock is left behind."""
    before = {name: set(getattr(bpy.data, name)) for name in _COLLECTIONS}
    try:
        yield
    finally:
        made = [block for name in _COLLECTIONS for block in set(getattr(bpy.data, name)) - before[name]]
        bpy.data.batch_remove(made)


def add_volumes(family: str, values: Mapping[str, Any], volumes: tuple[Volume, ...], name: str,
                collection: bpy.types.Collection, baked: LightGrid | None = None) -> list[bpy.types.Object]:
    """An object for each volume; in EEVEE it shines with the ``baked`` light, where there is some."""
    result = []
    for volume in volumes:
        glow = light.picture(baked, volume.domain.center, f"{name} light") if baked else None
        material = groups.material(family, values, volume.domain, name, groups.fields_of(volume, glow))
        if isinstance(volume.medium.density, Grid):
            domain = grid.body(volume, name, material, collection)
        else:
            domain = objects.body(volume.domain, name, material, collection)
        if volume.boundary is None:  # a box, ball or cone of lines: the faces of the mesh would fill the view
            domain.display_type = "BOUNDS"
            domain.display_bounds_type = {Box: "BOX", Ellipsoid: "SPHERE", Cone: "CONE"}[type(volume.domain)]
        result.append(domain)
    return result


def build(scene: Scene, parameters: Sequence[tuple[str, Mapping[str, Any]]], plan: Plan, label: str,
          baked: Mapping[int, LightGrid] | None = None) -> bpy.types.Scene:
    """A Blender scene that shows the Scene, with the plan's settings applied.

    ``parameters`` holds the family of each volume and its values, from a preset or from scene.describe; ``baked`` the light of
    the volumes that have some, by their index.
    """
    baked = baked or {}
    result = bpy.data.scenes.new("Volumetrics")
    collection = result.collection
    for index, (volume, (family, values), settings_of_volume) in enumerate(
            zip(scene.volumes, parameters, plan.volume_settings, strict=True)):
        domain, = add_volumes(family, values, (volume,), label, collection, baked.get(index))
        set_volume_material(domain.material_slots[0].material, settings_of_volume)
    for index, source in enumerate(scene.lights):
        objects.light(source, f"{label} light {index}", collection)
    for index, surface in enumerate(scene.surfaces):
        objects.body(surface.shape, f"{label} body {index}",
                     objects.surface_material(surface, f"{label} body {index}"), collection)
    if plan.light_enclosure:
        add_enclosure(scene, "Light enclosure", collection)
    result.world = objects.world(scene.environment, "Volumetrics world")
    result.camera = objects.camera(scene.camera, clip_range(scene), "Volumetrics camera", collection)
    render = result.render
    render.engine = "CYCLES" if plan.engine == CYCLES else compat.current().eevee
    render.film_transparent = False
    render.use_compositing = render.use_sequencer = render.use_motion_blur = render.use_border = False
    render.dither_intensity = 0.0
    render.use_stamp = False
    settings.apply(result, plan.settings)
    return result


def set_volume_material(material: bpy.types.Material, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        if name == "homogeneous_volume" and not compat.current().homogeneous_flag:
            continue
        setattr(material.cycles, name, value)


def bounds(shape: Shape) -> tuple[list[float], list[float]]:
    """Axis-aligned world bounds of a shape."""
    data, placement = objects.mesh(shape, "bounds")
    points = [placement @ vertex.co for vertex in data.vertices]
    bpy.data.meshes.remove(data)
    return [min(p[i] for p in points) for i in range(3)], [max(p[i] for p in points) for i in range(3)]


def enclosure(scene: Scene) -> Box:
    """Box around all media and all lights that stand somewhere, one hundredth larger."""
    points = [corner for volume in scene.volumes for corner in bounds(volume.domain)]
    points += [light.position for light in scene.lights if not isinstance(light, Sun)]
    low, high = ([f(p[i] for p in points) for i in range(3)] for f in (min, max))
    pad = 0.01 * max(h - l for l, h in zip(low, high))
    center = tuple((l + h) / 2 for l, h in zip(low, high))
    return Box(center, tuple((h - l) / 2 + pad for l, h in zip(low, high)))


def add_enclosure(scene: Scene, name: str, collection: bpy.types.Collection) -> bpy.types.Object:
    """An empty volume for EEVEE alone: its output has EEVEE as target, and rays of Cycles pass it by."""
    material = bpy.data.materials.new(name)
    build_tree = Tree(compat.use_nodes(material))
    output = build_tree.node("ShaderNodeOutputMaterial", target="EEVEE")
    empty = build_tree.node("ShaderNodeVolumeScatter", {"Density": 0.0})
    build_tree.feed(socket_of(output.inputs, "Volume"), empty.outputs[0])
    result = objects.body(enclosure(scene), name, material, collection)
    result.display_type = "WIRE"
    result.hide_select = True
    for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(result, f"visible_{ray}", False)
    return result


def clip_range(scene: Scene) -> tuple[float, float]:
    """Camera clipping that holds the whole scene, with a ratio that EEVEE's depth can resolve."""
    reach = 0.0
    shapes = [volume.domain for volume in scene.volumes] + [surface.shape for surface in scene.surfaces]
    for shape in shapes:
        for corner in bounds(shape):
            reach = max(reach, sum((c - p) ** 2 for c, p in zip(corner, scene.camera.position)) ** 0.5)
    # Two opposite corners of the bounds do not hold the farthest one: their diagonal does.
    reach = 2.0 * max(reach, 1e-3)
    return reach * 1e-4, reach
