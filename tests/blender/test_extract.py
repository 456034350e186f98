# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights, world and camera that the package builds come back as they were; what it does not know is named."""

import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import build, extract, objects  # noqa: E402
from volumetrics_addon.scene.model import Camera, Point, Spot, Sun, normalized  # noqa: E402

LIGHTS = (Sun(normalized((0.3, 0.4, -0.8)), (4.0, 2.0, 1.0)), Point((1.0, 2.0, 3.0), (100.0, 80.0, 60.0)),
          Spot((-1.0, 0.0, 5.0), normalized((0.1, 0.2, -1.0)), (50.0, 60.0, 70.0), 0.8, 0.25))


def close(a, b):
    return a == pytest.approx(b, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: type(light).__name__)
def test_lights_come_back(light):
    with build.temporary():
        scene = bpy.data.scenes.new("scene")
        objects.light(light, "light", scene.collection)
        scene.view_layers[0].update()
        (found,), warnings = extract.lights(scene)
    assert type(found) is type(light) and not warnings
    for name, value in vars(light).items():
        assert close(getattr(found, name), value), name


def test_exposure_temperature_and_hidden_lights():
    with build.temporary():
        scene = bpy.data.scenes.new("scene")
        first = objects.light(LIGHTS[1], "first", scene.collection)
        objects.light(LIGHTS[0], "hidden", scene.collection).hide_render = True
        first.data.exposure = 2.0
        first.data.use_temperature, first.data.temperature = True, 2000.0
        (found,), _ = extract.lights(scene)
        expected = tuple(4.0 * p * t for p, t in zip(LIGHTS[1].power, first.data.temperature_color))
    assert close(found.power, expected)


def test_an_area_light_is_named_and_left_out():
    with build.temporary():
        scene = bpy.data.scenes.new("scene")
        scene.collection.objects.link(bpy.data.objects.new("Softbox", bpy.data.lights.new("Softbox", "AREA")))
        found, warnings = extract.lights(scene)
    assert found == () and len(warnings) == 1 and "Softbox" in warnings[0] and "use a sun" in warnings[0]


def test_world_and_camera():
    with build.temporary():
        scene = bpy.data.scenes.new("scene")
        assert extract.environment(scene) == ((0.0, 0.0, 0.0), [])
        with pytest.raises(ValueError, match="add a camera"):
            extract.camera(scene)
        scene.world = objects.world((0.3, 0.6, 1.2), "world")
        color, warnings = extract.environment(scene)
        assert close(color, (0.3, 0.6, 1.2)) and not warnings
        background = next(n for n in scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
        sky = scene.world.node_tree.nodes.new("ShaderNodeTexEnvironment")
        scene.world.node_tree.links.new(sky.outputs[0], background.inputs[0])
        color, warnings = extract.environment(scene)
        assert color == (0.0, 0.0, 0.0) and "one colour" in warnings[0]
        source = Camera((1.0, -5.0, 2.0), normalized((0.1, 1.0, -0.2)), 0.7)
        scene.camera = objects.camera(source, (0.1, 100.0), "camera", scene.collection)
        scene.view_layers[0].update()
        found = extract.camera(scene)
    assert close(found.position, source.position) and close(found.direction, source.direction)
    assert close(found.field_of_view, source.field_of_view)
