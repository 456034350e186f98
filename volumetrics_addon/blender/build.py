# SPDX-License-Identifier: GPL-3.0-or-later
"""From a Scene to a Blender scene of its own, and away again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import bpy

from ..plan import rules
from ..plan.model import CYCLES, Plan
from ..reference import depth_air
from ..scene import units
from ..scene.body import Body
from ..scene.model import Box, Cone, Ellipsoid, Grid, Hull, Light, Projector, Scene, Shape, Sun
from . import compat, compositing, dimming, fields, grid, groups, light, objects, projector, settings
from .nodes import Tree, socket_of

if TYPE_CHECKING:  # importing path tracing takes longer than adding most presets
    from ..reference.light_balance import Balance
    from ..reference.light_grid import LightGrid

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


def add_body(body: Body, name: str, collection: bpy.types.Collection, baked: LightGrid | None = None,
             material: bpy.types.Material | None = None) -> bpy.types.Object:
    """The object that holds the body's media, with ``material`` or its family's; in EEVEE it shines with ``baked`` light."""
    first = body.volumes[0]
    glow = light.picture(baked, body.domain.center, f"{name} light") if baked else None
    material = material or groups.material(body.family, body.values, body.domain, name, fields.fields_of(first, glow))
    if isinstance(first.medium.density, Grid):
        result = grid.body(first, name, material, collection)
    else:
        result = objects.body(body.domain, name, material, collection, cavity=first.cavity)
    if not first.has_surface:  # a box, ball or cone of lines: the faces of the mesh would fill the view
        result.display_type = "BOUNDS"
        result.display_bounds_type = {Box: "BOX", Ellipsoid: "SPHERE", Cone: "CONE", Hull: "BOX"}[type(body.domain)]
    return result


def build(scene: Scene, bodies: Sequence[Body], plan: Plan, label: str, baked: Mapping[int, LightGrid] | None = None,
          balance: Balance | None = None) -> bpy.types.Scene:
    """A Blender scene that shows the Scene in the plan's unit of length, with the plan's settings applied.

    ``bodies`` holds the scene's volumes, from a preset or from scene.describe; ``baked`` the light of the bodies that have
    some, by their index; ``balance`` what its lights and its sky are dimmed to in EEVEE.
    """
    baked = baked or {}
    if plan.unit != 1.0:
        scene, bodies = units.scaled(scene, 1.0 / plan.unit), [units.scaled_body(body, 1.0 / plan.unit) for body in bodies]
        baked = {index: grid.scaled(1.0 / plan.unit) for index, grid in baked.items()}
    air = plan.compositor_fog and any(body.family.name == "air" for body in bodies)
    if air:
        scene = depth_air.below_air(scene)
    result = bpy.data.scenes.new("Volumetrics")
    collection = result.collection
    shown = () if plan.compositor_fog else bodies
    for index, (body, settings_of_volume) in enumerate(zip(shown, plan.volume_settings, strict=True)):
        domain = add_body(body, label, collection, baked.get(index))
        set_volume_material(domain.material_slots[0].material, settings_of_volume)
    for index, source in enumerate(scene.lights):
        lamps = add_light(source, f"{label} light {index}", collection, scene, plan.engine)
        if balance:
            for lamp in lamps:
                dimming.apply(lamp, balance.surfaces[index], balance.media[index], collection)
    for index, surface in enumerate(scene.surfaces):
        objects.body(surface.shape, f"{label} body {index}",
                     objects.surface_material(surface, f"{label} body {index}"), collection, scene.camera.position)
    if plan.light_enclosure:
        add_enclosure(scene.lights, bodies, "Light enclosure", collection)
    result.world = objects.world(scene.environment, "Volumetrics world", balance.sky if balance else (1.0, 1.0, 1.0))
    result.camera = objects.camera(scene.camera, clip_range(scene, [body for body in bodies if body.domain and not air], plan.engine), "Volumetrics camera", collection)
    render = result.render
    render.engine = "CYCLES" if plan.engine == CYCLES else compat.current().eevee
    render.film_transparent = air  # the environment that lights its ground is no sky
    render.use_compositing = render.use_sequencer = render.use_motion_blur = render.use_border = False
    render.dither_intensity = 0.0
    render.use_stamp = False
    settings.apply(result, plan.settings)
    if plan.compositor_fog:
        suns = [candidate for candidate in collection.objects if candidate.type == "LIGHT"]
        for body in bodies:
            compositing.add(result, body, suns, scene.environment, label, scene.orders)
    return result


def add_light(source: Light, name: str, collection: bpy.types.Collection, scene: Scene, engine: str | None = None,
              live: bpy.types.NodeTree | None = None) -> list[bpy.types.Object]:
    """The light, for one engine or for both: a projector is nodes in Cycles and a mask before the light in EEVEE.

    ``live`` is the node group of its gobo, where that is not a picture. Returns its lamps, of which a coloured gobo has three.
    """
    if isinstance(source, Projector):
        return projector.add(source, name, collection, engine, rules.reach(scene, source.position), live)
    return [objects.light(source, name, collection)]


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


def enclosure(lights: Sequence[Light], bodies: Sequence[Body]) -> Box:
    """Box around all media and all lights that stand somewhere, one hundredth larger."""
    points = [corner for body in bodies for corner in bounds(body.domain)]
    points += [light.position for light in lights if not isinstance(light, Sun)]
    low, high = ([f(p[i] for p in points) for i in range(3)] for f in (min, max))
    pad = 0.01 * max(h - l for l, h in zip(low, high))
    center = tuple((l + h) / 2 for l, h in zip(low, high))
    return Box(center, tuple((h - l) / 2 + pad for l, h in zip(low, high)))


def add_enclosure(lights: Sequence[Light], bodies: Sequence[Body], name: str,
                  collection: bpy.types.Collection) -> bpy.types.Object:
    """An empty volume for EEVEE alone: its output has EEVEE as target, and rays of Cycles pass it by."""
    material = bpy.data.materials.new(name)
    build_tree = Tree(compat.use_nodes(material))
    output = build_tree.node("ShaderNodeOutputMaterial", target="EEVEE")
    empty = build_tree.node("ShaderNodeVolumeScatter", {"Density": 0.0})
    build_tree.feed(socket_of(output.inputs, "Volume"), empty.outputs[0])
    result = objects.body(enclosure(lights, bodies), name, material, collection)
    result.display_type = "WIRE"
    result.hide_select = True
    for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(result, f"visible_{ray}", False)
    return result


def clip_range(scene: Scene, bodies: Sequence[Body], engine: str) -> tuple[float, float]:
    """Camera clipping that holds the whole scene, for EEVEE with a ratio that its depth can resolve.

    The medium nearer than the start does not count in either engine.
    """
    eye = scene.camera.position
    reach, clearance = 0.0, math.inf
    for shape in (surface.shape for surface in scene.surfaces):
        if isinstance(shape, Ellipsoid) and objects.is_ground(shape, eye):
            # What a planet hides is never in the picture.
            distance, radius = math.dist(eye, shape.center), max(shape.half)
            reach = max(reach, math.sqrt(max(0.0, (distance - radius) * (distance + radius))))
            clearance = min(clearance, abs(distance - radius))
        else:
            reach = max(reach, *(math.dist(corner, eye) for corner in bounds(shape)))
    for body in bodies:
        reach = max(reach, *(math.dist(corner, eye) for corner in bounds(body.domain)))
    # Two opposite corners of the bounds do not hold the farthest one: their diagonal does.
    reach = 2.0 * max(reach, 1e-3)
    if engine == CYCLES:
        return 1e-7 * reach, reach
    # From a tower the ground below is nearer than a ten thousandth of the air's reach.
    return max(1e-7 * reach, min(1e-4 * reach, 0.05 * clearance)), reach
