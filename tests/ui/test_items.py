# SPDX-License-Identifier: GPL-3.0-or-later
"""Adding a preset to a user's file and removing it again leaves the file as it was."""

import json
import math

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from volumetrics_addon.blender import items, settings
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load, names

COLLECTIONS = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
# Changes with every load; deprecated in Blender 5, where reading it warns; of the viewport.
NO_SETTINGS = {"rna_type", "session_uid", "use_nodes", "display"}


pytestmark = pytest.mark.usefixtures("extension")


@pytest.fixture
def scene():
    """Blender's start-up file: a cube, a camera, a light."""
    bpy.ops.wm.read_factory_settings()
    return bpy.context.scene


def data():
    return {name: sorted(block.name for block in getattr(bpy.data, name)) for name in COLLECTIONS}


def state(struct, depth=3):
    """Every value below a Blender struct that is not another datablock."""
    result = {}
    for declared in struct.bl_rna.properties:
        if declared.identifier in NO_SETTINGS or declared.type == "COLLECTION":
            continue
        value = getattr(struct, declared.identifier)
        if declared.type != "POINTER":
            result[declared.identifier] = tuple(value) if getattr(declared, "is_array", False) else value
        elif value is not None and not isinstance(value, bpy.types.ID) and depth:
            result[declared.identifier] = state(value, depth - 1)
    return result


def file_state(scene):
    """All datablocks, all settings of the scene and its engines, and everything in its collections."""
    found = {"data": data(), "scene": state(scene), "keys": sorted(scene.keys()),
             "objects": {o.name: [list(row) for row in o.matrix_world] for o in scene.objects},
             "tree": {c.name: (sorted(o.name for o in c.objects), sorted(child.name for child in c.children))
                      for c in (scene.collection, *scene.collection.children_recursive)}}
    assert len(found["scene"]["cycles"]) > 80 and len(found["scene"]["eevee"]) > 30 and len(found["scene"]["render"]) > 60
    return found


def add(name, **parameters):
    panel = bpy.context.window_manager.volumetrics
    panel.preset = name
    for key, value in parameters.items():
        setattr(getattr(panel, load(name).family), key, value)
    assert bpy.ops.volumetrics.add() == {"FINISHED"}
    return items.items(bpy.context.scene)[-1]


def remove(item):
    assert bpy.ops.volumetrics.remove(item=item.name) == {"FINISHED"}


def user_scene_settings(scene):
    """Settings below, at and above what an item wants, as a user may have them."""
    scene.cycles.volume_bounces = 1
    scene.cycles.max_bounces = 3
    scene.cycles.transmission_bounces = 1000
    scene.eevee.volumetric_samples = 32
    scene.eevee.use_volumetric_shadows = False
    scene.eevee.light_threshold = 0.02
    scene.eevee.clamp_volume_indirect = 5.0


# --- add and remove --------------------------------------------------------------------------------------------


def test_there_are_presets_to_add():
    assert len(names()) >= 8


@pytest.mark.parametrize("name", names())
def test_removing_restores_the_file(name, scene):
    user_scene_settings(scene)
    before = file_state(scene)
    item = add(name)
    preset = load(name)
    assert item.name == preset.label and items.record(item)["family"] == preset.family
    assert len(item.objects) >= 1 and all(o.name in scene.objects for o in item.objects)
    assert bpy.context.view_layer.objects.active in set(item.objects)
    assert set(bpy.context.view_layer.objects.selected) == {o for o in item.objects if not o.hide_select}
    changed = state(scene)
    assert changed["cycles"]["volume_bounces"] == max(1, preset.stage["orders"] - 1)
    assert changed["cycles"]["transmission_bounces"] == 1000  # raised, never lowered
    assert changed["eevee"]["use_volumetric_shadows"] and changed["eevee"]["clamp_volume_indirect"] == 0.0
    assert scene.world == bpy.data.worlds[0] and len(bpy.data.worlds) == 1
    remove(item)
    assert file_state(scene) == before


@pytest.mark.parametrize("family", FAMILIES)
def test_adding_and_removing_many_times_leaves_no_datablock(family, scene):
    kinds = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    assert len(kinds) > 30
    before = {kind: len(getattr(bpy.data, kind)) for kind in kinds}
    for _ in range(12):
        item = items.add_item(scene, family, FAMILIES[family].defaults(), family)
        assert len(bpy.data.materials) > before["materials"]
        items.remove_item(scene, item)
    assert {kind: len(getattr(bpy.data, kind)) for kind in kinds} == before


PAIRS = [("cumulus", "emerald-sphere"), ("emerald-sphere", "cumulus"), ("morning-valley", "theatre-slats"),
         ("cumulus", "cumulus"), ("tea-glass", "ember-smoke")]


@pytest.mark.parametrize("first_goes_first", [True, False])
@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_two_items_are_removed_in_either_order(pair, first_goes_first, scene):
    user_scene_settings(scene)
    before = file_state(scene)
    added = [add(name) for name in pair]
    assert len({item.name for item in added}) == 2
    with_both = state(scene)
    there = added.pop(0 if first_goes_first else 1)
    remove(there)
    (left,) = added
    # What the other item needs is still there.
    for path, value in items.record(left)["applied"].items():
        now = settings.get(scene, path)
        assert settings.same(now, value) or (isinstance(value, int) and now >= value), path
    assert with_both["cycles"]["max_bounces"] >= scene.cycles.max_bounces
    remove(left)
    assert file_state(scene) == before


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2), (1, 2, 0), (0, 2, 1), (2, 0, 1)])
def test_three_items_in_every_order(order, scene):
    user_scene_settings(scene)
    before = file_state(scene)
    added = [add(name) for name in ("ember-smoke", "cumulus", "emerald-sphere")]
    for index in order:
        remove(added[index])
    assert file_state(scene) == before


def test_add_stands_at_the_cursor(scene):
    scene.cursor.location = (1.0, 2.0, 3.0)
    cloud = add("cumulus", location=(0.0, 0.0, 10.0))
    assert np.allclose(cloud.objects[0].matrix_world.translation, (1.0, 2.0, 13.0))
    beam = add("theatre-slats", location=(0.0, 0.0, 6.0), target=(0.0, 0.0, 0.0))
    light = next(o for o in beam.objects if o.type == "LIGHT")
    assert np.allclose(light.matrix_world.translation, (1.0, 2.0, 9.0))
    assert np.allclose(light.matrix_world.to_3x3() @ Vector((0.0, 0.0, -1.0)), (0.0, 0.0, -1.0), atol=1e-6)


def test_fog_is_fitted_to_scene_and_camera(scene):
    fog = add("sea-fog", margin=3.0)
    corners = np.array([fog.objects[0].matrix_world @ v.co for v in fog.objects[0].data.vertices])
    cube, camera = bpy.data.objects["Cube"], bpy.data.objects["Camera"]
    points = np.array([*(cube.matrix_world @ v.co for v in cube.data.vertices), camera.matrix_world.translation])
    assert np.allclose(corners.min(axis=0)[:2], points.min(axis=0)[:2] - 3.0, atol=1e-4)
    assert np.allclose(corners.max(axis=0)[:2], points.max(axis=0)[:2] + 3.0, atol=1e-4)
    # A second fog is fitted to the scene and not to the first.
    again = add("sea-fog", margin=3.0)
    assert np.allclose(again.objects[0].dimensions, fog.objects[0].dimensions)


# --- what is refused -------------------------------------------------------------------------------------------


def test_fog_with_nothing_to_fit_adds_nothing():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    before = file_state(scene)
    with pytest.raises(RuntimeError, match="nothing to fit the fog to; add a camera or an object"):
        add("sea-fog")
    assert file_state(scene) == before and items.items(scene) == []


def test_light_at_its_own_target_adds_nothing(scene):
    before = file_state(scene)
    with pytest.raises(RuntimeError, match="direction"):
        add("theatre-slats", location=(1.0, 1.0, 1.0), target=(1.0, 1.0, 1.0))
    assert file_state(scene) == before


@pytest.mark.parametrize("name", ["", "Cube", "Collection", "Cumulus puff.001"])
def test_removing_what_is_not_there(name, scene):
    add("cumulus")
    before = file_state(scene)
    with pytest.raises(RuntimeError, match="no item named"):
        bpy.ops.volumetrics.remove(item=name)
    assert file_state(scene) == before


def test_not_in_edit_mode(scene):
    item = add("cumulus")
    bpy.context.view_layer.objects.active = item.objects[0]
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.volumetrics.add.poll() and not bpy.ops.volumetrics.remove.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.volumetrics.add.poll() and bpy.ops.volumetrics.remove.poll()


# --- what the user did in between ------------------------------------------------------------------------------


def test_a_setting_that_the_user_changed_stays(scene):
    user_scene_settings(scene)
    before = file_state(scene)
    item = add("cumulus")
    scene.cycles.volume_bounces = 7
    scene.eevee.light_threshold = 0.5
    remove(item)
    after = file_state(scene)
    assert after["scene"]["cycles"].pop("volume_bounces") == 7
    assert after["scene"]["eevee"].pop("light_threshold") == pytest.approx(0.5)
    del before["scene"]["cycles"]["volume_bounces"], before["scene"]["eevee"]["light_threshold"]
    assert after == before


def test_a_material_used_elsewhere_survives(scene):
    item = add("ember-smoke")
    material = item.objects[0].material_slots[0].material
    cube = bpy.data.objects["Cube"]
    cube.data.materials[0] = material
    remove(item)
    assert cube.data.materials[0] == material
    group = next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeGroup").node_tree
    assert group.users == 1 and len(bpy.data.objects) == 3


def test_what_the_user_put_into_the_item_survives(scene):
    item = add("cumulus")
    cube, own = bpy.data.objects["Cube"], bpy.data.collections.new("Own")
    bpy.data.collections["Collection"].objects.unlink(cube)
    item.objects.link(cube)
    item.children.link(own)
    own.objects.link(bpy.data.objects.new("Marker", None))
    remove(item)
    assert {"Cube", "Marker"} <= set(scene.objects.keys())
    assert own in set(scene.collection.children)
    assert not [o for o in bpy.data.objects if items.TAG in o]


def test_what_the_user_linked_elsewhere_survives(scene):
    item = add("cumulus")
    domain = item.objects[0]
    bpy.data.collections["Collection"].objects.link(domain)
    remove(item)
    assert domain.name in scene.objects and domain.material_slots[0].material is not None


def test_a_duplicate_is_removed_too_and_deleted_parts_are_no_trouble(scene):
    before = file_state(scene)
    item = add("theatre-slats")
    copy = item.objects[0].copy()
    copy.data = item.objects[0].data.copy()
    item.objects.link(copy)
    bpy.data.objects.remove(next(o for o in item.objects if o.type == "LIGHT"))
    item.name = "My beam"
    remove(item)
    assert file_state(scene) == before


def test_an_item_whose_material_was_replaced_has_no_live_node(scene):
    item = add("cumulus")
    item.objects[0].material_slots[0].material = bpy.data.materials.new("Plain")
    assert items.live_node(item) is None
    item.objects[0].material_slots[0].material = None
    assert items.live_node(item) is None


# --- live parameters -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cumulus", "emerald-sphere", "sea-fog", "theatre-slats"])
def test_live_sockets_mirror_the_declaration(name, scene):
    item = add(name)
    preset = load(name)
    node = items.live_node(item)
    interface = [s for s in node.node_tree.interface.items_tree if s.item_type == "SOCKET" and s.in_out == "INPUT"]
    assert len(interface) == len(node.inputs) == len(preset.group.live) >= 3
    for parameter, declared, socket in zip(preset.group.live, interface, node.inputs):
        assert (declared.name, declared.description) == (parameter.label, parameter.description)
        value = socket.default_value
        if parameter.kind == "color":
            assert np.allclose(tuple(value)[:3], preset.parameters[parameter.name], rtol=1e-6)
            continue
        value = tuple(value) if parameter.kind == "vector" else value
        factor = math.radians(1.0) if parameter.unit == "deg" else 1.0
        assert np.allclose(value, factor * np.array(preset.parameters[parameter.name]), rtol=1e-6)
        limits = factor * parameter.minimum, factor * parameter.maximum
        assert (declared.min_value, declared.max_value) == pytest.approx(limits, rel=1e-6)
        assert (declared.subtype == "DISTANCE") == (parameter.unit == "m")
    assert {parameter.name for parameter in FAMILIES[preset.family].live} < set(preset.parameters)


# --- save and load ---------------------------------------------------------------------------------------------


def saved_and_loaded(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False)
    bpy.ops.wm.read_factory_settings()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def test_removing_after_save_and_load(scene, tmp_path):
    user_scene_settings(scene)
    saved_and_loaded(tmp_path / "before.blend")  # so that what loading does by itself is in both
    scene = bpy.context.scene
    before = file_state(scene)
    for name in ("cumulus", "theatre-slats"):
        add(name)
    scene = saved_and_loaded(tmp_path / "with.blend")
    assert [item.name for item in items.items(scene)] == [load("cumulus").label, load("theatre-slats").label]
    assert scene.cycles.volume_bounces == load("cumulus").stage["orders"] - 1
    for item in items.items(scene):
        json.loads(item[items.KEY])
        remove(item)
    assert file_state(scene) == before
    data = (tmp_path / "before.blend").read_bytes()
    assert b"olumetrics" not in data.replace(bytes(str(tmp_path), "utf-8"), b"")  # no trace in a file without items


def test_animation_of_live_sockets_survives_save_and_load(scene, tmp_path):
    node = items.live_node(add("cumulus"))
    node.inputs["Extinction"].default_value = 0.25
    node.inputs["Extinction"].keyframe_insert("default_value", frame=1)
    node.inputs["Extinction"].default_value = 0.75
    node.inputs["Extinction"].keyframe_insert("default_value", frame=11)
    node.inputs["Coverage"].driver_add("default_value").driver.expression = "frame / 100"

    scene = saved_and_loaded(tmp_path / "animated.blend")
    (item,) = items.items(scene)
    for frame, extinction in ((1, 0.25), (11, 0.75)):
        scene.frame_set(frame)
        material = item.objects[0].material_slots[0].material.evaluated_get(bpy.context.evaluated_depsgraph_get())
        node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
        assert node.inputs["Extinction"].default_value == pytest.approx(extinction)
        assert node.inputs["Coverage"].default_value == pytest.approx(frame / 100)
    remove(item)
    assert items.items(scene) == []


def test_the_record_lies_on_the_collection(scene):
    """So undo, save and load take it along with the item."""
    item = add("cumulus")
    assert set(items.record(item)) == {"id", "family", "label", "orders", "values", "before", "applied"}
    assert set(items.record(item)["before"]) == set(items.record(item)["applied"])
    for path, value in items.record(item)["applied"].items():
        assert settings.same(settings.get(scene, path), value), path


# --- voxels ------------------------------------------------------------------------------------------------------


def test_baking_keeps_place_material_and_animation(scene):
    item = add("cumulus", resolution=24)
    old = item.objects[0]
    old.location.x += 100.0
    old.rotation_euler.z = 0.5
    bpy.context.view_layer.update()
    placed = old.matrix_world.copy()
    node = items.live_node(item)
    node.inputs["Coverage"].default_value = 0.6
    node.inputs["Extinction"].default_value = 0.125
    node.inputs["Extinction"].keyframe_insert("default_value", frame=1)
    material = old.material_slots[0].material
    kept = items.values_of(item)
    location = kept["location"]
    assert "fill" in items.effective(item) and "droplet_diameter" not in items.effective(item)

    items.bake_item(scene, item)
    (body,) = item.objects
    assert body.material_slots[0].material == material and material.node_tree.animation_data.action is not None
    assert items.values_of(item) == kept | {"representation": "baked"} and not items.can_bake(item)
    assert "fill" not in items.effective(item) and "extinction" in items.effective(item)
    node = items.live_node(item)
    assert node.inputs["Extinction"].default_value == pytest.approx(0.125)
    assert all(any(s.is_linked for s in output.inputs) for output in material.node_tree.nodes
               if output.bl_idname == "ShaderNodeOutputMaterial")
    # The middle of the domain lies where the user had moved it.
    bpy.context.view_layer.update()
    turn = placed @ Matrix.Translation(location).inverted()
    center = Matrix.Translation(body.matrix_world.translation)
    local = turn.inverted() @ center.translation
    size = kept["size"]
    assert all(abs(local[k] - location[k]) < size[k] / 2 for k in range(3))
    assert np.allclose(body.matrix_world.to_3x3(), placed.to_3x3(), atol=1e-6)
    evaluated = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert evaluated.material_slots[0].material is not None
    with pytest.raises(ValueError, match="no noise to bake"):
        items.bake_item(scene, item)


def test_a_baked_item_leaves_nothing_behind(scene):
    before = data()
    item = add("cumulus", resolution=16)
    items.bake_item(scene, item)
    remove(item)
    assert data() == before
    item = add("cumulus", resolution=16, representation="baked")
    assert not items.can_bake(item)
    remove(item)
    assert data() == before


# --- baked light -------------------------------------------------------------------------------------------------


def bake(item):
    assert bpy.ops.volumetrics.bake_light(item=item.name) == {"FINISHED"}


@pytest.mark.parametrize("representation", ["procedural", "baked"])
def test_baked_light_goes_with_its_item(representation, scene):
    before = file_state(scene)
    item = add("cumulus", representation=representation, resolution=16, light_resolution=6)
    node = items.live_node(item)
    node.inputs[0].default_value = 0.03
    item.objects[0].location.x += 40.0
    bpy.context.view_layer.update()
    bake(item)
    node = items.live_node(item)
    assert node.inputs[0].default_value == pytest.approx(0.03)
    picture, = (image for image in bpy.data.images if items.TAG in image)
    pixels = np.array(picture.pixels).reshape(-1, 4)[:, :3]
    assert pixels.max() > 0.0  # the start-up file's lamp and world
    groups = len(bpy.data.node_groups)
    bake(item)  # again: the earlier one is replaced
    assert len(bpy.data.node_groups) == groups and len([i for i in bpy.data.images if items.TAG in i]) == 1
    remove(item)
    assert file_state(scene) == before


def test_light_that_cannot_be_baked_is_refused(scene):
    item = add("cumulus", light_resolution=6)
    camera, scene.camera = scene.camera, None
    before = file_state(scene)
    with pytest.raises(RuntimeError, match="no camera"):
        bpy.ops.volumetrics.bake_light(item=item.name)
    scene.camera = camera
    item.objects[0].scale = (2.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="turned or scaled"):
        bpy.ops.volumetrics.bake_light(item=item.name)
    with pytest.raises(RuntimeError, match="only clouds"):
        bpy.ops.volumetrics.bake_light(item=add("tea-glass").name)
    with pytest.raises(RuntimeError, match="no item named"):
        bpy.ops.volumetrics.bake_light(item="nobody")
    assert before["data"]["images"] == file_state(scene)["data"]["images"]
