# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in a user's own scene: add one, find them, remove one and leave the file as it was.

An item is a collection that carries one custom property: the family, the preset's name and what the scene's settings
were before. Every datablock made for it is tagged, so that removal takes them and nothing else.
"""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import bpy
from mathutils import Matrix, Vector

from ..parameters.families import FAMILIES
from ..parameters.model import decimal
from ..plan.model import CYCLES, EEVEE
from ..plan.rules import eevee_lights, is_baked, light_resolution, participation, plan
from ..scene import assemble
from ..scene.bake import voxelized
from ..scene.body import Body
from ..scene.families.item import Item
from ..scene.model import Camera, Scene, Sun, Volume, add
from . import build, compat, compositing, dimming, extract, fields, gobo, grid, groups, light, objects, settings
from .nodes import socket_factor

KEY = "volumetrics"
TAG = "volumetrics_item"
COMPOSITOR_WOULD_DO = ("Only suns light this scene: added with the realisation Compositor, this fog has no noise and costs a moment, but "
                       "casts no shafts")
DRAFT_PIXELS = 8
BAKE_SAMPLES = 32  # paths of each voxel: seconds, also with NumPy alone
# In the order of use: lights free the collections of what they shadow, which hold objects; those free meshes, and those geometry
# nodes, which free materials, and those shader nodes.
_OWNED = ("objects", "collections", "objects", "meshes", "lights", "node_groups", "materials", "node_groups", "images")


def items(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """The collections of all items in the scene, in the order they were added."""
    return [collection for collection in scene.collection.children_recursive if KEY in collection]


def record(item: bpy.types.ID) -> dict[str, Any]:
    return json.loads(item[KEY])


def holders(scene: bpy.types.Scene) -> list[bpy.types.ID]:
    """Whatever remembers settings of the scene: the items, and objects of the user's own that are of glass."""
    return items(scene) + [candidate for candidate in scene.objects if KEY in candidate]


def live_node(item: bpy.types.Collection) -> bpy.types.Node | None:
    """The group node whose sockets are the item's live parameters: in its material, or in the compositor."""
    if record(item).get("compositor"):
        return compositing.node_of(record(item)["id"], TAG)
    return live_node_of(item.objects)


def live_node_of(objects: Iterable[bpy.types.Object]) -> bpy.types.Node | None:
    """The first group node of ours among the materials of these objects."""
    for candidate in objects:
        for slot in candidate.material_slots:
            if slot.material is None or slot.material.node_tree is None:
                continue
            for node in slot.material.node_tree.nodes:
                if node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None and TAG in node.node_tree:
                    return node
    return None


def values_of(item: bpy.types.Collection) -> dict[str, Any]:
    """The item's parameters: as it was added, and those that are live and have an effect as they are now."""
    mine = record(item)
    family = FAMILIES[mine["family"]]
    values = family.defaults() | mine.get("values", {})
    node = live_node(item)
    shown = effective(item)
    for parameter, socket in zip(family.live, node.inputs if node else ()):
        if parameter.name not in shown:
            continue
        value = socket.default_value
        if parameter.kind == "float":
            value = decimal(value / socket_factor(parameter))
        elif parameter.kind in ("color", "vector"):
            value = tuple(map(decimal, tuple(value)[:3]))
        values[parameter.name] = value
    return family.check(values)


def effective(item: bpy.types.Collection) -> list[str]:
    """Names of the live parameters that have an effect: not of another phase function, nor of a shape that is baked or built."""
    mine = record(item)
    family = FAMILIES[mine["family"]]
    values = family.defaults() | mine.get("values", {})
    if is_baked(values):
        values["density"] = "baked"
    if "realisation" in values:
        values["realisation"] = "compositor" if mine.get("compositor") else "volume"
    has_effect = family.applies if mine.get("compositor") else family.reacts  # the compositor has no domain that was built
    return [parameter.name for parameter in family.live if has_effect(parameter.name, values)]


def notes(scene: bpy.types.Scene, item: bpy.types.Collection) -> list[str]:
    """What an engine does otherwise than the item's parameters say, what is left out of this scene, and what would be quicker."""
    mine, values = record(item), values_of(item)
    if mine.get("compositor"):
        return warnings(scene, item)
    if mine["family"] == "fog" and values["profile"] in ("exponential", "slab") and mine["orders"] == 1:
        lights = {candidate.data.type for candidate in scene.objects if candidate.type == "LIGHT" and not candidate.hide_render}
        return [COMPOSITOR_WOULD_DO] if lights == {"SUN"} else []
    if mine["family"] != "godray" or values["light"] != "projector":
        return []
    # Without pictures: panels ask often.
    plain = assemble.ASSEMBLERS["godray"]({**values, "gobo": "none", "blocker": "none"}, None)
    return list(filter(None, [eevee_lights(plain.lights)]))


def _volume(item: bpy.types.Collection) -> tuple[dict[str, Any], Volume]:
    """Values and medium of an item of one volume, where it was added."""
    values = values_of(item)
    volume, = assemble.ASSEMBLERS[record(item)["family"]](values, None).volumes
    volume = compat.as_evaluated(volume)
    return values, voxelized(volume, values["resolution"]) if is_baked(values) else volume


def _domain(item: bpy.types.Collection) -> bpy.types.Object:
    """The object with the item's own material."""
    tree = live_node(item).id_data
    return next(candidate for candidate in item.objects
                if any(slot.material and slot.material.node_tree == tree for slot in candidate.material_slots))


def can_bake(item: bpy.types.Collection) -> bool:
    values = values_of(item)
    return values.get("density") == "noise" and not is_baked(values)


def bake_item(scene: bpy.types.Scene, item: bpy.types.Collection) -> None:
    """Replace the item's noise by voxels, where and as it is now. Its material, with its animation, stays.

    Raises ValueError where there is no noise to bake.
    """
    if not can_bake(item):
        raise ValueError(f"{item.name} has no noise to bake: it is homogeneous or made of voxels already")
    mine, node, old = record(item), live_node(item), _domain(item)
    material = old.material_slots[0].material
    before = {name: set(getattr(bpy.data, name)) for name in _OWNED}
    values, volume = _volume(item)
    moved = old.matrix_world @ objects.placement(volume.domain).inverted()  # by the user, since it was added
    values["representation"] = "baked"
    volume = voxelized(volume, values["resolution"])
    medium = assemble.body(mine["family"], values, (volume,))
    described = Scene(Camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0), volumes=(volume,), orders=mine["orders"])
    cycles = plan(described, [medium], CYCLES, 1, has_null_scattering=compat.current().volume_biased)
    build.set_volume_material(material, *cycles.volume_settings)
    node.node_tree = groups.group(medium.family, values, volume.domain, mine["label"], fields.fields_of(volume))
    body = grid.body(volume, old.name, material, item)
    body.matrix_world = moved @ objects.placement(volume.domain)
    body.display_type, body.display_bounds_type = "BOUNDS", "BOX"
    for child in old.children:
        child.parent, child.matrix_parent_inverse = body, body.matrix_world.inverted()
    name = old.name
    bpy.data.meshes.remove(old.data)  # and with it the object
    body.name = name
    for kind in _OWNED:
        for block in set(getattr(bpy.data, kind)) - before[kind]:
            block[TAG] = mine["id"]
    free(mine["id"])
    item[KEY] = json.dumps(mine | {"values": values})


def scene_bounds(scene: bpy.types.Scene) -> assemble.Bounds:
    """Bounds of the scene's visible geometry and its camera. Raises ValueError when there is neither."""
    points = []
    mine = {candidate for item in items(scene) for candidate in item.objects}
    for candidate in scene.objects:
        if candidate in mine or candidate.hide_render:
            continue
        if candidate.type == "CAMERA":
            points.append(tuple(candidate.matrix_world.translation))
        elif candidate.type in {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}:
            points += [tuple(candidate.matrix_world @ Vector(corner)) for corner in candidate.bound_box]
    return assemble.Bounds(points)


def add_item(scene: bpy.types.Scene, family: str, values: Mapping[str, Any], label: str, orders: int = 1,
             offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bpy.types.Collection:
    """Add a family with the given parameters to the scene, moved by ``offset``.

    Raises ParameterError on a refused value and ValueError where a fitted domain finds nothing to fit; then nothing
    has been added.
    """
    values = FAMILIES[family].check(values)
    for name in ("location", "target"):
        if name in values:
            values[name] = add(values[name], offset)
    if assemble.is_composited(values):
        compositing.check(scene)
    bounds = scene_bounds(scene) if family == "fog" else None
    # In a user's scene a gobo is nodes; of its picture only counts whether it has colours.
    draft = {"gobo_resolution": DRAFT_PIXELS} if values.get("gobo", "none") not in ("none", "image") else {}
    item = assemble.ASSEMBLERS[family]({**values, **draft}, bounds)
    if is_baked(values):
        item.volumes = tuple(voxelized(compat.as_evaluated(volume), values["resolution"]) for volume in item.volumes)
    return place_item(scene, family, values, item, label, orders)


def place_item(scene: bpy.types.Scene, family: str, values: Mapping[str, Any], item: Item, label: str,
               orders: int = 1) -> bpy.types.Collection:
    """Add what a family has made of checked values to the scene: one object for each domain, all with one material."""
    # The camera is not known here; a planet's ground is seen from about where it passes through the origin.
    eye = (0.0, 0.0, values.get("base_height", 0.0))
    described = Scene(Camera(eye, (0.0, 1.0, 0.0), 1.0), item.lights, volumes=item.volumes,
                      surfaces=item.surfaces, orders=orders)

    before = {name: set(getattr(bpy.data, name)) for name in _OWNED}
    collection = bpy.data.collections.new(label)
    scene.collection.children.link(collection)
    media = assemble.bodies(family, values, item.volumes)
    if assemble.is_composited(values):
        return _add_to_compositor(scene, media[0], collection, label, orders, before)
    domain = build.add_body(media[0], label, collection)
    material = domain.material_slots[0].material
    cycles = plan(described, media, CYCLES, 1, has_null_scattering=compat.current().volume_biased)
    # The rate counts in shares of each domain: the material takes the shortest steps.
    build.set_volume_material(material, min(cycles.volume_settings, key=lambda chosen: chosen["volume_step_rate"]))
    for medium in media[1:]:
        build.add_body(medium, label, collection, material=material)
    pattern, node = None, next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeGroup")
    if item.lights and values.get("light") == "projector" and values["gobo"] != "none":
        pattern = gobo.group(values, item.lights[0], f"{label} gobo", material, node)
    for source in item.lights:
        lamps = build.add_light(source, f"{label} light", collection, described, live=pattern)
        if not isinstance(source, Sun):
            for lamp in lamps:
                dimming.follow(lamp, source, math.dist(values["location"], values["target"]), item.volumes, material, node,
                               FAMILIES[family])
    for surface in item.surfaces:
        part = f"{label} {'ground' if family == 'air' else 'blocker'}"
        objects.body(surface.shape, part, objects.surface_material(surface, part), collection, eye)
    if plan(described, media, EEVEE, 1).light_enclosure:
        build.add_enclosure(described.lights, media, f"{label} light enclosure", collection)

    identity = _tag(before)
    for part in collection.objects:  # whatever belongs to the item moves with its domain
        if part != domain:
            part.parent = domain
            part.matrix_parent_inverse = domain.matrix_world.inverted()
    wanted = participation(described, lambda path, default: settings.get(scene, path))
    changed = settings.apply(scene, wanted)
    collection[KEY] = json.dumps({"id": identity, "family": family, "label": label, "orders": orders, "values": values,
                                  "before": changed, "applied": wanted})
    return collection


def _tag(before: Mapping[str, set]) -> str:
    """A new identity, on every datablock made since ``before``."""
    identity = uuid.uuid4().hex
    for name in _OWNED:
        for block in set(getattr(bpy.data, name)) - before[name]:
            block[TAG] = identity
    return identity


def _add_to_compositor(scene: bpy.types.Scene, body: Body, collection: bpy.types.Collection, label: str, orders: int,
                       before: Mapping[str, set]) -> bpy.types.Collection:
    """Fog or air as a pass of the scene's compositor, lit by the suns that the scene renders and by its world of one colour."""
    suns = [candidate for candidate in scene.objects
            if candidate.type == "LIGHT" and candidate.data.type == "SUN" and not candidate.hide_render]
    sky, unread = extract.environment(scene)
    try:
        compositing.add(scene, body, suns, sky, label, orders, keep_background=bool(unread) or max(sky) > 0.0)
    except ValueError:
        bpy.data.collections.remove(collection)
        raise
    wanted = {"render.use_compositing": True}
    changed = settings.apply(scene, wanted)
    collection[KEY] = json.dumps({"id": _tag(before), "family": body.family.name, "label": label, "orders": orders,
                                  "values": dict(body.values), "before": changed, "applied": wanted, "compositor": True})
    return collection


def warnings(scene: bpy.types.Scene, item: bpy.types.Collection) -> list[str]:
    """What the item leaves out of this scene, in words for its user."""
    if not record(item).get("compositor"):
        return []
    lamps = sorted({candidate.data.type.lower() for candidate in scene.objects
                    if candidate.type == "LIGHT" and candidate.data.type != "SUN" and not candidate.hide_render})
    found = [f"{kind} lights do not shine into the compositor's fog; choose the volume for them" for kind in lamps]
    return found + extract.environment(scene)[1]


def can_bake_light(item: bpy.types.Collection) -> bool:
    """Whether the item's light in EEVEE can be baked: clouds whose material is still their own."""
    return record(item)["family"] == "cloud" and live_node(item) is not None


def bake_light(scene: bpy.types.Scene, item: bpy.types.Collection, *, samples: int = BAKE_SAMPLES) -> list[str]:
    """Bake the light that the item scatters towards the scene's camera, all orders of it, for EEVEE.

    The item is lit by the scene's lights and world as ``extract`` reads them, its live values are taken as they are; bodies
    cast no shadow into it. An earlier bake is replaced. Returns warnings about what was left out. Raises ValueError where the
    item is no cloud or its domain was turned or scaled, and where the scene has no camera; then nothing has changed.
    """
    from ..reference import light_grid  # path tracing, which nothing else here needs

    mine = record(item)
    if not can_bake_light(item):
        raise ValueError(f"{item.name} has no light to bake: only clouds with their own material have; add a cloud")
    node, domain = live_node(item), _domain(item)
    values, volume = _volume(item)
    moved = domain.matrix_world @ objects.placement(volume.domain).inverted()
    if max(abs(value) for row in moved.to_3x3() - Matrix.Identity(3) for value in row) > 1e-6:
        raise ValueError(f"{domain.name} is turned or scaled, and light is baked along its axes; bring both back and change the size")
    # The scene seen from the item, as it was added: where the user has moved it, lights and camera move instead.
    back = tuple(-moved.translation)
    camera = extract.camera(scene)
    lights, warnings = extract.lights(scene)
    environment, more = extract.environment(scene)
    lit = Scene(replace(camera, position=add(camera.position, back)),
                tuple(source if isinstance(source, Sun) else replace(source, position=add(source.position, back)) for source in lights),
                environment, (volume,), orders=mine["orders"])
    baked = light_grid.bake(lit, 0, light_resolution(volume, values), samples=samples, smoothing=light_grid.SMOOTHING)
    before, old = set(bpy.data.images), node.node_tree
    picture = light.picture(baked, volume.domain.center, f"{mine['label']} light")
    node.node_tree = groups.group(FAMILIES[mine["family"]], values, volume.domain, old.name, fields.fields_of(volume, picture))
    for block in (node.node_tree, *(set(bpy.data.images) - before)):
        block[TAG] = mine["id"]
    free(mine["id"])
    return warnings + more


def remove_item(scene: bpy.types.Scene, item: bpy.types.Collection) -> None:
    """Remove the item's objects and what was made for them, and bring back the settings it changed.

    Data that the user has put to use elsewhere stays. A setting goes back only when the user has not changed it since;
    where a later item builds on it, that item inherits the older value to go back to.
    """
    mine = record(item)
    restore_settings(scene, mine)
    if mine.get("compositor") and (node := live_node(item)):
        compositing.remove(scene, node)
    for guest in item.objects:  # what the user has moved in moves out
        if guest.get(TAG) != mine["id"] and guest.users_collection == (item,):
            scene.collection.objects.link(guest)
    for guest in item.children:
        if guest.name not in scene.collection.children:
            scene.collection.children.link(guest)
    bpy.data.collections.remove(item)
    free(mine["id"])


def free(identity: str) -> None:
    """Remove what was made for an item and is no longer used."""
    for name in _OWNED:
        for block in list(getattr(bpy.data, name)):
            if block.get(TAG) == identity and block.users == 0:
                getattr(bpy.data, name).remove(block)


def restore_settings(scene: bpy.types.Scene, mine: Mapping[str, Any]) -> None:
    """Bring back what the scene had before the holder with this record; a later holder that builds on it inherits that."""
    others = [other for other in holders(scene) if record(other)["id"] != mine["id"]]
    going_back = dict(mine["before"])
    for path, applied in mine["applied"].items():
        for other in others:
            theirs = record(other)
            if path in theirs["before"] and settings.same(theirs["before"][path], applied):
                theirs["before"][path] = going_back.pop(path)
                other[KEY] = json.dumps(theirs)
                break
    settings.restore(scene, going_back, mine["applied"])
