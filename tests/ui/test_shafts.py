# SPDX-License-Identifier: GPL-3.0-or-later
"""Shafts from the faces of a mesh, by the operator."""

import math

import bpy
import bmesh  # isort: skip, it is a part of bpy
import numpy as np
import pytest
from mathutils import Matrix

from volumetrics_addon.blender import items, render
from volumetrics_addon.scene.openings import shaft

TILT, TURN = math.radians(50.0), math.radians(10.0)
DIRECTION = (math.sin(TURN) * -math.sin(TILT), math.cos(TURN) * math.sin(TILT), -math.cos(TILT))  # of (0, 0, -1) turned


pytestmark = pytest.mark.usefixtures("extension")


@pytest.fixture
def wall():
    """A wall of four by four faces, two metres high, across +y, and a sun."""
    bpy.ops.wm.read_factory_settings()
    bpy.ops.object.light_add(type="SUN", rotation=(TILT, 0.0, TURN))
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=2.0, location=(0.0, 0.0, 3.0),
                                    rotation=(math.pi / 2, 0, 0))
    bpy.context.view_layer.update()
    return bpy.context.object


def select(wall, chosen):
    bpy.ops.object.mode_set(mode="EDIT")
    data = bmesh.from_edit_mesh(wall.data)
    for face in data.faces:
        face.select_set(face.index in chosen)
    bmesh.update_edit_mesh(wall.data)


def blocks():
    return {name: sorted(block.name for block in getattr(bpy.data, name)) for name in
            ("objects", "meshes", "materials", "node_groups", "collections", "lights", "images")}


def corners(part):
    return sorted(tuple(round(x, 4) for x in part.matrix_world @ vertex.co) for vertex in part.data.vertices)


def test_all_faces_make_the_shaft_of_the_whole_wall(wall):
    before = blocks()
    assert bpy.ops.volumetrics.shafts(end="floor", floor_height=0.0, extinction=0.125) == {"FINISHED"}
    (item,) = items.items(bpy.context.scene)
    (part,) = item.objects
    expected = shaft([(-1, 0, 2), (1, 0, 2), (1, 0, 4), (-1, 0, 4)], DIRECTION, floor=0.0)
    assert np.allclose(corners(part), sorted(expected.corners), atol=2e-4)
    values = items.values_of(item)
    assert (values["light"], values["irradiance"], values["extinction"]) == ("sun", 0.0, 0.125)
    assert [values[k] for k in ("opening_width", "opening_height")] == pytest.approx([2.0, 2.0], abs=1e-5)
    assert bpy.ops.volumetrics.remove(item=item.name) == {"FINISHED"}
    assert blocks() == before


def test_selected_faces_make_theirs(wall):
    """Three windows that share no plane outline: a row of two, one beside it above, one far off; all with one material."""
    select(wall, {0, 1, 4, 15})
    assert bpy.ops.volumetrics.shafts(end="length", length=5.0) == {"FINISHED"}
    assert bpy.context.mode == "OBJECT"
    (item,) = items.items(bpy.context.scene)
    assert len(item.objects) == 3 and len({part.material_slots[0].material for part in item.objects}) == 1
    volumes = [volume_of(part) for part in item.objects]
    # Area times the cosine of the incidence times the length, less the first thousandth and the gap between neighbours.
    pane = 0.25 * abs(DIRECTION[1]) * 5.0 * 0.999
    assert sorted(volumes) == pytest.approx(sorted([pane, pane * 0.995**2, 2 * pane * 0.995**2]), rel=1e-4)
    node = items.live_node(item)
    assert {user.node_tree for part in item.objects for user in part.material_slots[0].material.node_tree.nodes
            if user.bl_idname == "ShaderNodeGroup"} == {node.node_tree}


def volume_of(part):
    build = bmesh.new()
    build.from_mesh(part.data)
    result = build.calc_volume()
    build.free()
    return result


def test_a_face_that_is_not_convex_becomes_convex_parts(wall):
    data = bpy.data.meshes.new("Angle")
    data.from_pydata([(-1, 0, 2), (1, 0, 2), (1, 0, 3), (0, 0, 3), (0, 0, 4), (-1, 0, 4)], [], [tuple(range(6))])
    angle = bpy.data.objects.new("Angle", data)
    bpy.context.scene.collection.objects.link(angle)
    bpy.context.view_layer.objects.active = angle
    bpy.context.view_layer.update()
    assert bpy.ops.volumetrics.shafts(end="length", length=5.0) == {"FINISHED"}
    parts = items.items(bpy.context.scene)[-1].objects
    assert len(parts) == 2
    assert sum(map(volume_of, parts)) == pytest.approx(3.0 * abs(DIRECTION[1]) * 5.0 * 0.999 * 0.995**2, rel=1e-4)


def no_sun(wall):
    bpy.data.objects.remove(bpy.data.objects["Sun"])


def nothing_selected(wall):
    select(wall, set())


def sun_along(wall):
    bpy.data.objects["Sun"].rotation_euler = (0.0, 0.0, 0.0)


def no_mesh(wall):
    bpy.context.view_layer.objects.active = bpy.data.objects["Camera"]


def sun_from_below(wall):
    bpy.data.objects["Sun"].rotation_euler = (math.radians(120.0), 0.0, 0.0)


@pytest.mark.parametrize(("change", "reason"), [
    (no_sun, "no sun .*add a sun light"), (nothing_selected, "no face of Grid is selected; select"),
    (sun_along, "along every chosen face of Grid; turn the sun"), (no_mesh, "make a mesh the active object"),
    (sun_from_below, "does not fall to the floor")], ids=lambda x: getattr(x, "__name__", ""))
def test_what_is_refused_adds_nothing(wall, change, reason):
    change(wall)
    bpy.context.view_layer.update()
    before, mode = blocks(), bpy.context.mode
    with pytest.raises(RuntimeError, match=reason):
        bpy.ops.volumetrics.shafts()
    assert blocks() == before and items.items(bpy.context.scene) == [] and bpy.context.mode == mode


def test_faces_along_the_sun_are_left_out_with_a_warning(wall):
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(4, 0, 3))
    bpy.data.objects["Sun"].rotation_euler = (math.radians(45.0), 0.0, 0.0)
    bpy.context.view_layer.update()
    from volumetrics_addon.blender import shafts

    _, warnings = shafts.add_shafts(bpy.context.scene, bpy.context.object, False, {})
    assert warnings == ["2 faces are left out: the sun shines along them", "2 shafts are left out: they begin in those of other faces"]
    assert len(items.items(bpy.context.scene)[-1].objects) == 2  # of the four others two lie behind


def test_the_shaft_is_lit_by_the_sun_of_the_scene(wall):
    """Cycles, in the user's scene: radiance across the shaft as its closed form gives it, and none beside it."""
    scene, sun = bpy.context.scene, bpy.data.objects["Sun"].data
    sun.energy, sun.angle, sun.color = 6.0, 0.0, (1.0, 0.5, 0.25)
    bpy.data.objects.remove(bpy.data.objects["Light"])
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    # The camera looks along x, at right angles to the light, which has no part along x.
    bpy.data.objects["Sun"].rotation_euler = (TILT, 0.0, 0.0)
    bpy.context.view_layer.update()
    assert bpy.ops.volumetrics.shafts(end="length", length=6.0, extinction=0.4) == {"FINISHED"}
    wall.hide_render = True
    node = items.live_node(items.items(scene)[0])
    node.inputs["Anisotropy g"].default_value, node.inputs["Albedo"].default_value = 0.0, (0.8, 0.8, 0.8, 1.0)
    way = 3.0
    camera = scene.camera
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.01
    camera.matrix_world = Matrix((
        (0, 0, -1, -5), (-1, 0, 0, math.sin(TILT) * way), (0, 1, 0, 3 - math.cos(TILT) * way), (0, 0, 0, 1)))
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 256, False
    scene.cycles.use_adaptive_sampling, scene.cycles.device = False, "CPU"
    image = render.render_built(scene, 4, 4).mean(axis=(0, 1, 2))
    strength = 0.8 * 6.0 / (4 * math.pi) * math.exp(-0.4 * (way - 0.006)) * -math.expm1(-0.4 * 2.0)
    assert np.allclose(image, strength * np.array([1.0, 0.5, 0.25]), rtol=0.01)
    camera.location.z += 4.0
    assert np.array_equal(render.render_built(scene, 4, 4), np.zeros((1, 4, 4, 3)))


def test_one_step_undoes_it(wall):
    bpy.ops.ed.undo_push(message="before")
    before = blocks()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ed.undo_push(message="Edit Mode")
    assert bpy.ops.volumetrics.shafts("EXEC_DEFAULT", True) == {"FINISHED"}
    assert blocks() != before and bpy.context.mode == "OBJECT"
    bpy.ops.ed.undo()
    assert blocks() == before and bpy.context.mode == "EDIT_MESH"


def test_a_picture_that_is_missing_adds_nothing(wall):
    scene, before = bpy.context.scene, blocks()
    with pytest.raises(ValueError, match="gobo_image = /no/such.png: there is no such file"):
        items.add_item(scene, "godray", {"light": "projector", "gobo": "image", "gobo_image": "/no/such.png"}, "Slide")
    assert blocks() == before and items.items(scene) == []


@pytest.mark.parametrize(("changes", "known"), [
    ({"light": "projector"}, True), ({"light": "projector", "falloff": "linear"}, False), ({"light": "projector", "near": 0.5}, False),
    ({"light": "projector", "far": 4.0, "gobo": "water"}, False), ({"light": "spot"}, True), ({"light": "sun"}, True)])
def test_the_panel_says_what_eevee_does_otherwise(wall, changes, known):
    item = items.add_item(bpy.context.scene, "godray", changes, "Beam")
    expected = [] if known else ["EEVEE's lights fall off with the square of the distance and have no near or far end"]
    assert items.notes(bpy.context.scene, item) == expected
