# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass on a mesh of the user's own: measured ways, pictures at every scale, and a file left as it was."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Vector  # noqa: E402

from volumetrics_addon.blender import chords, compat, items, mesh_glass, objects, render, settings  # noqa: E402
from volumetrics_addon.cli.doctor import checks  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.physics.transmittance import shell_path_length  # noqa: E402
from volumetrics_addon.plan.rules import plan  # noqa: E402
from volumetrics_addon.scene.model import Camera, Scene  # noqa: E402

needs_eevee = pytest.mark.skipif(not all(c.ok for c in checks() if c.name == "EEVEE"), reason="no EGL on this machine")
VALUES = {"color": [0.2, 0.5, 0.9], "distance": 1.0, "ior": 1.5}


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def ball(subdivisions=4, radius=1.0, location=(0.0, 0.0, 0.0)):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=subdivisions, radius=radius, location=location)
    made = bpy.context.object
    for polygon in made.data.polygons:
        polygon.use_smooth = True
    return made


def ways(target, direction):
    """The stored way inside at each corner, along a world direction for all of them, by the formula of the nodes."""
    count = len(target.data.loops)
    alpha, gamma, tau = np.empty(count), np.empty(count), np.empty(3 * count)
    target.data.attributes[chords.LENGTH].data.foreach_get("value", alpha)
    target.data.attributes[chords.SLOPE].data.foreach_get("value", gamma)
    target.data.attributes[chords.SKEW].data.foreach_get("vector", tau)
    matrix = np.array(target.matrix_world.to_3x3())
    scale = float(np.linalg.norm(matrix @ np.full(3, 3.0**-0.5)))
    cosine = -corner_normals(target) @ np.asarray(direction)
    return scale * (alpha + gamma * cosine) + scale**2 * (tau.reshape(-1, 3) @ np.linalg.inv(matrix) @ np.asarray(direction))


def corner_normals(target):
    normals = np.empty(3 * len(target.data.loops))
    target.data.corner_normals.foreach_get("vector", normals)
    normals = normals.reshape(-1, 3) @ np.linalg.inv(np.array(target.matrix_world.to_3x3()))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def file_state(target):
    data = target.data
    return {"keys": sorted(target.keys()), "slots": [(slot.link, slot.material) for slot in target.material_slots],
            "materials": list(data.materials), "attributes": sorted(data.attributes.keys()),
            "vertices": [tuple(v.co) for v in data.vertices],
            "data": {name: len(getattr(bpy.data, name)) for name in ("materials", "meshes", "node_groups", "images", "objects")}}


# --- ways through the mesh --------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_ways_through_a_ball_are_its_chords(scene, turn):
    """d = 2 R cos, whatever the direction; the normals of facets are up to 2 % off, their mean volume 0.2 %."""
    made = ball(5, radius=0.5)
    made.rotation_euler = (turn, 0.0, turn)
    made.location = (3.0, 1.0, -2.0)
    mesh_glass.apply(scene, made, VALUES)
    normals = corner_normals(made)
    for direction in ((0.0, 0.6, 0.8), (1.0, 0.0, 0.0)):
        cosine = -normals @ np.array(direction)
        facing = cosine > 0.75  # a refracted ray is at most 41.8 degrees from the normal
        assert facing.sum() > 100
        np.testing.assert_allclose(ways(made, direction)[facing], cosine[facing], rtol=0.03)
        assert (ways(made, direction)[facing] / cosine[facing]).mean() == pytest.approx(1.0, abs=0.003)


def test_an_even_scale_needs_no_measure(scene):
    made = ball()
    mesh_glass.apply(scene, made, VALUES)
    before = ways(made, (0.0, 0.0, -1.0))
    made.scale = (3.0, 3.0, 3.0)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(ways(made, (0.0, 0.0, -1.0)), 3.0 * before, rtol=1e-6)


def test_ways_through_a_slab_are_its_thickness_over_the_cosine(scene):
    """At the middle of a wide slab, within the 2 % that a straight line in omega is off."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, size=40.0)
    made = bpy.context.object
    made.modifiers.new("thick", "SOLIDIFY").thickness = 0.2
    mesh_glass.apply(scene, made, VALUES)
    middle = [loop.index for loop in made.data.loops if made.data.vertices[loop.vertex_index].co.length < 1e-3]
    assert middle
    for angle in (0.0, 0.3, 0.6):
        direction = (math.sin(angle), 0.0, -math.cos(angle))
        assert ways(made, direction)[middle] == pytest.approx(np.full(len(middle), 0.2 / math.cos(angle)), rel=0.02)
    made.scale = (1.0, 1.0, 3.0)
    mesh_glass.measure(scene, made)
    assert ways(made, (0.0, 0.0, -1.0))[middle] == pytest.approx(np.full(len(middle), 0.6), rel=0.02)


def test_both_sides_of_a_solidified_plane_have_its_thickness(scene):
    """The modifier hands one face's numbers to the faces of both sides, whose normals are opposite."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, size=40.0)
    made = bpy.context.object
    solid = made.modifiers.new("thick", "SOLIDIFY")
    solid.thickness, solid.offset = 0.2, 0.0
    mesh_glass.apply(scene, made, VALUES)
    seen = made.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    sides = set()
    for loop in seen.loops:
        place = seen.vertices[loop.vertex_index].co
        if place.xy.length < 1e-3:
            alpha, gamma = (seen.attributes[name].data[loop.index].value for name in (chords.LENGTH, chords.SLOPE))
            skew = Vector(seen.attributes[chords.SKEW].data[loop.index].vector)
            sides.add(place.z > 0.0)
            assert alpha + gamma == pytest.approx(0.2, rel=0.02) and skew.length < 0.01
    assert sides == {True, False}


def test_ways_through_a_hollow_ball_are_both_walls(scene):
    """Along the normal 2 (R - r); against the closed form over a cone around it."""
    made = ball(5)
    inner = ball(5, 0.8)
    inner.data.flip_normals()
    with bpy.context.temp_override(active_object=made, selected_editable_objects=[made, inner]):
        bpy.ops.object.join()
    chords.refuse_open(made, bpy.context.evaluated_depsgraph_get())
    tree = chords.BVHTree.FromObject(made, bpy.context.evaluated_depsgraph_get())
    for sine in (0.0, 0.2, 0.5):
        start = Vector((0.0, 0.0, 0.999))
        length = chords._inside(tree, start, Vector((sine, 0.0, -math.sqrt(1.0 - sine**2))), 1e-6)
        assert length == pytest.approx(shell_path_length(0.999 * sine, 1.0, 0.8), rel=0.02)


def test_a_face_has_the_mean_of_its_ways(scene):
    """One corner a quadrant of a cube's face: along the normal every way is the cube's side."""
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    made = bpy.context.object
    mesh_glass.apply(scene, made, {**VALUES, "ior": 4.0})  # a narrow cone, which no side wall cuts
    normals = corner_normals(made)
    for axis in np.eye(3):
        facing = normals @ axis > 0.9
        assert ways(made, -axis)[facing].mean() == pytest.approx(2.0, rel=0.02)


# --- what is refused --------------------------------------------------------------------------------------------


def test_an_open_mesh_is_refused_with_its_edges(scene):
    bpy.ops.mesh.primitive_plane_add()
    plane = bpy.context.object
    before = file_state(plane)
    with pytest.raises(ValueError, match=r"Plane is not watertight: 4 of its 4 edges have only one face; close it .* thin pane"):
        mesh_glass.apply(scene, plane, VALUES)
    assert file_state(plane) == before
    mesh_glass.apply(scene, plane, {**VALUES, "shape": "sheet"})
    assert mesh_glass.has_glass(plane) and not mesh_glass.is_measured(plane)
    plane.modifiers.new("thick", "SOLIDIFY").thickness = 0.1  # closed by its modifiers
    mesh_glass.apply(scene, plane, VALUES)
    assert mesh_glass.is_measured(plane)


def test_other_faults_are_named(scene):
    made = ball(2)
    made.data.flip_normals()
    with pytest.raises(ValueError, match="point inwards.*Recalculate Outside"):
        mesh_glass.apply(scene, made, VALUES)
    build = chords.bmesh.new()
    build.from_mesh(made.data)
    build.faces.ensure_lookup_table()
    build.faces[0].normal_flip()
    build.to_mesh(made.data)
    build.free()
    with pytest.raises(ValueError, match="disagree about outside at 3 of its 120 edges"):
        mesh_glass.apply(scene, made, VALUES)
    bpy.ops.object.light_add(type="POINT")
    with pytest.raises(ValueError, match="Point is a light, not a mesh"):
        mesh_glass.apply(scene, bpy.context.object, VALUES)
    with pytest.raises(ValueError, match="no object is active"):
        mesh_glass.apply(scene, None, VALUES)
    empty = bpy.data.objects.new("Empty", bpy.data.meshes.new("Empty"))
    scene.collection.objects.link(empty)
    with pytest.raises(ValueError, match="no surface"):
        mesh_glass.apply(scene, empty, VALUES)
    with pytest.raises(ValueError, match="nothing to measure"):
        mesh_glass.measure(scene, made)


# --- putting on and taking away ---------------------------------------------------------------------------------


@pytest.mark.parametrize("slots", [0, 1, 3])
@pytest.mark.parametrize("shape", ["sphere", "sheet"])
def test_removing_gives_back_what_was_there(scene, slots, shape):
    made = ball(2)
    for index in range(slots):
        made.data.materials.append(bpy.data.materials.new(f"mine {index}"))
    if slots == 3:
        made.material_slots[1].link = "OBJECT"
        made.material_slots[1].material = bpy.data.materials.new("of the object")
    scene.cycles.transmission_bounces = 3
    before, bounces = file_state(made), scene.cycles.transmission_bounces
    mesh_glass.apply(scene, made, {**VALUES, "shape": shape, "coverage_pattern": "dirt"})
    assert len(made.material_slots) == max(1, slots)
    assert all(slot.material.name.startswith("Glass") for slot in made.material_slots)
    assert list(made.data.materials) == (before["materials"] or [None])  # the mesh keeps its own
    assert scene.cycles.transmission_bounces == 64
    mesh_glass.apply(scene, made, VALUES)  # again, over itself
    mesh_glass.remove(scene, made)
    assert file_state(made) == before and scene.cycles.transmission_bounces == bounces


def test_what_the_user_changes_meanwhile_stays(scene):
    made = ball(2)
    for index in range(2):
        made.data.materials.append(bpy.data.materials.new(f"mine {index}"))
    mesh_glass.apply(scene, made, VALUES)
    later = bpy.data.materials.new("later")
    made.material_slots[0].material = later
    scene.cycles.transmission_bounces = 77
    mesh_glass.remove(scene, made)
    assert [slot.material.name for slot in made.material_slots] == ["later", "mine 1"]
    assert scene.cycles.transmission_bounces == 77 and not list(made.keys())
    bare = ball(2)
    mesh_glass.apply(scene, bare, VALUES)
    bare.data.materials.clear()
    mesh_glass.remove(scene, bare)
    assert not bare.material_slots and not mesh_glass.has_glass(bare)


def test_objects_that_share_a_mesh(scene):
    made = ball(2)
    other = bpy.data.objects.new("other", made.data)
    scene.collection.objects.link(other)
    before = file_state(made), file_state(other)
    mesh_glass.apply(scene, made, VALUES)
    assert other.material_slots[0].material is None
    mesh_glass.apply(scene, other, {**VALUES, "color": [0.9, 0.1, 0.1]})
    assert made.material_slots[0].material != other.material_slots[0].material
    mesh_glass.remove(scene, made)
    assert chords.LENGTH in other.data.attributes
    mesh_glass.remove(scene, other)
    assert (file_state(made), file_state(other)) == before


def test_glass_and_items_give_back_settings_in_either_order(scene):
    scene.cycles.transmission_bounces = 5
    for glass_first in (True, False):
        made = ball(2)
        mesh_glass.apply(scene, made, VALUES)
        item = items.add_item(scene, "glass", {}, "Ball")
        if glass_first:
            mesh_glass.remove(scene, made)
            assert scene.cycles.transmission_bounces == 64
            items.remove_item(scene, item)
        else:
            items.remove_item(scene, item)
            assert scene.cycles.transmission_bounces == 64
            mesh_glass.remove(scene, made)
        assert scene.cycles.transmission_bounces == 5


# --- pictures ---------------------------------------------------------------------------------------------------


def stage(scene, engine, made, unit=1.0, samples=8):
    """Uniform light 1, and a camera that sees a ball of radius 1 unit equally big at any unit; the engine's settings."""
    scene.world = objects.world((1.0, 1.0, 1.0), "world")
    seen = Camera((0.0, -10.0 * unit, 0.0), (0.0, 1.0, 0.0), math.radians(12.0))
    scene.camera = objects.camera(seen, (0.01 * unit, 100.0 * unit), "camera", scene.collection)
    body = mesh_glass._body(scene, made, FAMILIES["glass"].check(VALUES))
    described = Scene(Camera((0.0, -10.0, 0.0), (0.0, 1.0, 0.0), 0.2), volumes=body.volumes, environment=(1.0, 1.0, 1.0))
    settings.apply(scene, plan(described, [body], engine, samples, has_null_scattering=compat.current().volume_biased).settings)
    scene.render.engine = "CYCLES" if engine == "cycles" else compat.current().eevee


def picture(scene):
    return render.render_built(scene, 10, 10)[0].mean(axis=(0, 1))


@pytest.fixture(scope="module")
def expected():
    """The mean over a ball's picture under uniform light, by its closed form R + (1 - R)^2 t / (1 - R t)."""
    x = np.tan(math.radians(6.0)) * (np.arange(240) + 0.5 - 120.0) / 120.0
    impact = 10.0 * np.sin(np.arctan(np.hypot(*np.meshgrid(x, x))))
    hit = impact < 1.0
    outside = np.sqrt(1.0 - impact[hit] ** 2)
    inside = np.sqrt(1.0 - (impact[hit] / 1.5) ** 2)
    s, p = (outside - 1.5 * inside) / (outside + 1.5 * inside), (1.5 * outside - inside) / (1.5 * outside + inside)
    r = (s**2 + p**2) / 2.0
    means = []
    for color in VALUES["color"]:
        t = color ** (2.0 * inside)
        shade = np.ones(impact.shape)
        shade[hit] = r + (1.0 - r) ** 2 * t / (1.0 - r * t)
        means.append(shade.mean())
    return np.array(means)


@pytest.mark.parametrize("unit, scale_length", [(1.0, 1.0), (1e-3, 1.0), (1.0, 1e-3)], ids=["m", "mm", "scene in mm"])
def test_a_ball_of_the_users_own_at_every_unit(unit, scale_length, scene, expected):
    """In Cycles; the facets of the ball lie inside it: within 1.5 %."""
    scene.unit_settings.scale_length = scale_length
    made = ball(4, unit)
    mesh_glass.apply(scene, made, {**VALUES, "distance": unit * scale_length})
    stage(scene, "cycles", made, unit, 64)
    np.testing.assert_allclose(picture(scene), expected, rtol=0.015)


def test_a_ball_without_refraction_is_its_chord(scene):
    """Beer-Lambert over 2 sqrt(1 - b^2), the mean over the middle of the ball; its facets lie up to 0.25 % inside."""
    made = ball(5)
    mesh_glass.apply(scene, made, {**VALUES, "refraction": False})
    assert not mesh_glass.is_measured(made) and chords.LENGTH not in made.data.attributes
    stage(scene, "cycles", made)
    scene.camera.data.angle_x = math.radians(1.0)
    x = 10.0 * np.tan(math.radians(0.5)) * (np.arange(40) + 0.5 - 20.0) / 20.0
    chord = 2.0 * np.sqrt(1.0 - sum(v**2 for v in np.meshgrid(x, x)))
    np.testing.assert_allclose(picture(scene), [(color**chord).mean() for color in VALUES["color"]], rtol=0.005)


@pytest.mark.either
@needs_eevee
def test_a_scaled_ball_in_eevee(scene, expected):
    """One measure and one material, shrunk to a thousandth: the ball's closed form again, within 1.5 %."""
    made = ball(4)
    mesh_glass.apply(scene, made, VALUES)
    for unit in (1.0, 1e-3):
        made.scale = (unit,) * 3
        socket, = (s for s in items.live_node_of([made]).inputs if s.name == "Distance")
        socket.default_value = unit
        stage(scene, "eevee", made, unit)
        np.testing.assert_allclose(picture(scene), expected, rtol=0.015)
