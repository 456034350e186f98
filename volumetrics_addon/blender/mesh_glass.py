# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass on a mesh of the user's own, and away again.

The object's slots are linked to the object and get the glass there: the mesh keeps its own materials, and other objects that
share the mesh keep theirs. What was in the slots before, and the scene's settings, are remembered on the object.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping
from typing import Any

import bpy

from ..parameters.families import FAMILIES
from ..plan.model import CYCLES
from ..plan.rules import participation, plan
from ..scene import assemble, units
from ..scene.model import Camera, Scene
from . import build, chords, compat, fields, groups, items, settings

FORMER = "volumetrics_former_{}"  # the object's own material of a slot


def has_glass(target: bpy.types.Object | None) -> bool:
    return target is not None and items.KEY in target


def is_measured(target: bpy.types.Object) -> bool:
    """Whether EEVEE's glass reads the way through the mesh, which has to be measured again when the mesh changes."""
    values = items.record(target)["values"]
    return values["refraction"] and values["shape"] != "sheet"


def apply(scene: bpy.types.Scene, target: bpy.types.Object, values: Mapping[str, Any], label: str = "Glass") -> None:
    """Make the object of glass: a pane with the shape ``sheet``, otherwise a body that fills the mesh.

    ``values`` are those of the family glass, in metres; the scene's unit scale tells how long a unit is. Place and size are the
    object's own. Raises ValueError where the object is no mesh or, for a body, where its mesh is not closed (see
    chords.refuse_open); then nothing has changed.
    """
    if target is None or target.type != "MESH":
        raise ValueError("no object is active; select a mesh" if target is None else
                         f"{target.name} is a {target.type.lower()}, not a mesh; convert it (Object > Convert > Mesh)")
    if target.library or target.data.library:
        raise ValueError(f"{target.name} is linked from another file; make it local (Object > Relations > Make Local)")
    values = FAMILIES["glass"].check(values)
    body = _body(scene, target, values)
    solid, refracts = values["shape"] != "sheet", values["refraction"]
    depsgraph = _depsgraph(scene)
    if solid:
        chords.refuse_open(target, depsgraph)
    elif not target.data.polygons:
        raise ValueError(f"{target.name} has no faces; take a mesh with a surface")
    if has_glass(target):
        remove(scene, target)
        depsgraph = _depsgraph(scene)
    identity = uuid.uuid4().hex
    before = {name: set(getattr(bpy.data, name)) for name in ("materials", "node_groups", "images")}
    read = fields.Fields(measured=True) if solid else fields.fields_of(body.volumes[0])
    material = groups.material(body.family, body.values, body.domain, label, read)
    described = Scene(Camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0), volumes=body.volumes)
    cycles = plan(described, [body], CYCLES, 1, has_null_scattering=compat.current().volume_biased)
    build.set_volume_material(material, *cycles.volume_settings)
    for name, blocks in before.items():
        for block in set(getattr(bpy.data, name)) - blocks:
            block[items.TAG] = identity
    if solid and refracts:
        chords.measure(target, values["ior"], depsgraph)
    wanted = participation(described, lambda path, default: settings.get(scene, path))
    changed = settings.apply(scene, wanted)
    links = _fill(target, material)
    target[items.KEY] = json.dumps({"id": identity, "family": "glass", "label": label, "values": values, "links": links,
                                    "before": changed, "applied": wanted})


def measure(scene: bpy.types.Scene, target: bpy.types.Object) -> None:
    """Measure the way through the mesh again, after the mesh, its modifiers or its proportions have changed.

    Raises ValueError where the object has no glass that reads it, or is no longer closed.
    """
    if not has_glass(target) or not is_measured(target):
        raise ValueError("there is nothing to measure: only refracting bodies read the way through their mesh; "
                         "put glass on a mesh")
    depsgraph = _depsgraph(scene)
    chords.refuse_open(target, depsgraph)
    node = items.live_node_of([target])
    ior = items.record(target)["values"]["ior"]
    if node is not None:
        ior = node.inputs[[p.name for p in FAMILIES["glass"].live].index("ior")].default_value
    chords.measure(target, max(1.0, ior), depsgraph)


def remove(scene: bpy.types.Scene, target: bpy.types.Object) -> None:
    """Bring back the materials that the object had, its mesh, and the settings that the glass changed.

    Materials that the user has put into its slots since stay.
    """
    mine = items.record(target)

    def is_ours(slot: bpy.types.MaterialSlot) -> bool:
        return slot.material is not None and slot.material.get(items.TAG) == mine["id"]

    for index, (slot, link) in enumerate(zip(target.material_slots, mine["links"])):
        if is_ours(slot):
            slot.material = target.get(FORMER.format(index))
            slot.link = link
    for key in [key for key in target.keys() if key.startswith(FORMER.format(""))]:
        del target[key]
    shares = [other for other in bpy.data.objects if other != target and other.data == target.data and has_glass(other)]
    if not mine["links"] and len(target.material_slots) == 1 and is_ours(target.material_slots[0]):  # it was added
        target.material_slots[0].material = None
        target.material_slots[0].link = "DATA"
        if shares:  # the last object of glass that shares the mesh takes the slot away
            shares[0][items.KEY] = json.dumps(items.record(shares[0]) | {"links": []})
        else:
            target.data.materials.clear()
    if not any(is_measured(other) for other in shares):
        chords.forget(target.data)
    del target[items.KEY]
    if not any(items.record(other)["id"] == mine["id"] for other in items.holders(scene)):  # a copy of the object needs them
        items.restore_settings(scene, mine)
        items.free(mine["id"])


def _body(scene: bpy.types.Scene, target: bpy.types.Object, values: Mapping[str, Any]):
    """The glass with the size of the object, in the scene's unit of length."""
    unit = scene.unit_settings.scale_length if scene.unit_settings.system != "NONE" else 1.0
    size = tuple(unit * side for side in target.dimensions)
    shape = "sheet" if values["shape"] == "sheet" else "sphere"
    if sorted(size)[1] <= 0.0:
        raise ValueError(f"{target.name} has the size {size} m: there is no surface; take a mesh with faces")
    placed = {**values, "shape": shape, "location": (0.0, 0.0, 0.0), "size": size, "rotation": 0.0}
    described = assemble.body("glass", placed, assemble.ASSEMBLERS["glass"](placed).volumes)
    return units.scaled_body(described, 1.0 / unit)


def _fill(target: bpy.types.Object, material: bpy.types.Material) -> list[str]:
    """Put the material into all slots, linked to the object; returns how they were linked, nothing where there was no slot."""
    links = []
    for index, slot in enumerate(target.material_slots):
        links.append(slot.link)
        slot.link = "OBJECT"
        if slot.material is not None:
            target[FORMER.format(index)] = slot.material
        slot.material = material
    if not links:
        target.data.materials.append(None)
        target.material_slots[0].link = "OBJECT"
        target.material_slots[0].material = material
    return links


def _depsgraph(scene: bpy.types.Scene) -> bpy.types.Depsgraph:
    layer = scene.view_layers[0] if bpy.context.scene != scene else bpy.context.view_layer
    layer.update()
    return layer.depsgraph
