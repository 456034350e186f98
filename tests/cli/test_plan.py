# SPDX-License-Identifier: GPL-3.0-or-later
"""``volumetrics plan FILE``: what it says, what it saves, and what it refuses."""

import json

import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import compat, files, tuning  # noqa: E402
from volumetrics_addon.cli.main import FAILED, OK, USAGE, main  # noqa: E402


@pytest.fixture
def scene_file(tmp_path):
    """The start-up file with an empty medium, a far lamp and a pass that nobody reads."""
    bpy.ops.wm.read_factory_settings()
    scene = bpy.context.scene
    scene.render.engine, scene.frame_end = "CYCLES", 1
    material = bpy.data.materials.new("haze")
    tree = compat.use_nodes(material)
    shader, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    bpy.data.objects["Cube"].material_slots[0].material = material
    far = bpy.data.objects.new("far", bpy.data.lights.new("far", "POINT"))
    far.location = (9000.0, 0.0, 0.0)
    scene.collection.objects.link(far)
    scene.view_layers[0].use_pass_z = True
    scene.cycles.volume_bounces = 100
    path = tmp_path / "scene.blend"
    files.save(path)
    yield path
    bpy.ops.wm.read_factory_settings()


def test_a_plan_in_words(scene_file, capsys):
    assert main(["plan", str(scene_file)]) == OK
    text = capsys.readouterr().out
    assert "Scene in cycles" in text and "0.20% allowed" in text
    for part in ("idle lamps: changes", "object far: lights all but Cube", "bounces: changes", "instead of 100: of the light, 0.48 at most",
                 "passes: same picture", "view_layer ViewLayer: use_pass_z = False", "nothing to do for: thin media, unseen media"):
        assert part in text, part


def test_a_plan_as_json_with_rules_switched_off(scene_file, capsys):
    assert main(["plan", str(scene_file), "--json", "--without", "passes", "--error", "1%"]) == OK
    found = json.loads(capsys.readouterr().out)
    assert found["engine"] == "cycles" and found["target"] == 0.01 and found["saved"] is None
    rules = {rule["rule"]: rule for rule in found["rules"]}
    assert "passes" not in rules and 0.0 < rules["bounces"]["bound"] < 0.01
    assert found["bound"] == pytest.approx(sum(rule["bound"] for rule in found["rules"]))
    assert {"owner": "scenes", "name": "", "path": "cycles.volume_bounces"}.items() <= rules["bounces"]["changes"][0].items()


def test_the_plan_is_saved_under_another_name(scene_file, tmp_path, capsys):
    before = scene_file.read_bytes()
    out = tmp_path / "deep" / "planned.blend"
    assert main(["plan", str(scene_file), "--out", str(out), "--quiet"]) == OK
    assert scene_file.read_bytes() == before
    scene = files.open_scene(out)
    assert tuning.is_applied(scene) and scene.cycles.volume_bounces < 100
    tuning.restore(scene)
    assert scene.cycles.volume_bounces == 100 and scene.view_layers[0].use_pass_z


def test_an_engine_of_choice(scene_file, capsys):
    assert main(["plan", str(scene_file), "--engine", "eevee", "--json"]) == OK
    found = json.loads(capsys.readouterr().out)
    assert found["engine"] == "eevee"
    changes = [change for rule in found["rules"] for change in rule["changes"]]
    assert {"owner": "lights", "name": "far", "path": "volume_factor", "value": 0.0} in changes


@pytest.mark.parametrize("arguments, code, message", [
    (["--without", "speed"], USAGE, "no rule 'speed'"),
    (["--scene", "Other"], USAGE, "no scene 'Other'"),
    (["--out", "x.exr"], USAGE, "end the name with .blend"),
    (["--error", "0"], USAGE, "0 is not allowed"),
])
def test_what_is_refused(scene_file, capsys, arguments, code, message):
    assert main(["plan", str(scene_file), *arguments]) == code
    assert message in capsys.readouterr().err


def test_a_file_that_is_none(tmp_path, capsys):
    assert main(["plan", str(tmp_path / "none.blend")]) == FAILED
    assert "there is no file" in capsys.readouterr().err


def test_the_plan_of_a_preset(capsys):
    assert main(["plan", "morning-valley"]) == OK
    text = capsys.readouterr().out
    assert "Morning valley" in text and "ray marching: steps of" in text and "off with --without 'ray marching'" in text
    assert main(["plan", "morning-valley", "--without", "ray marching", "--json"]) == OK
    rules = json.loads(capsys.readouterr().out)["rules"]
    assert [rule["rule"] for rule in rules] == (["bounces"] if bpy.app.version >= (5, 0, 0) else ["bounces", "ray marching"])


@pytest.mark.parametrize("arguments, message", [
    (["--without", "octaves"], "use --cloud.scattering full"), (["--error", "1%"], "--error is not allowed with a preset"),
    (["--out", "x.blend"], "--out is not allowed with a preset")])
def test_what_a_preset_refuses(capsys, arguments, message):
    assert main(["plan", "morning-valley", *arguments]) == USAGE
    assert message in capsys.readouterr().err
