# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: what it prints, writes and returns, with and without Blender, and when it is interrupted."""

import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from volumetrics_addon.cli import doctor
from volumetrics_addon.cli.main import COMMANDS, FAILED, INTERRUPTED, OK, USAGE, WORSE, main, parser
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load, names, parse
from volumetrics_addon.parameters.stage import STAGE

ROOT = Path(__file__).resolve().parent.parent.parent
TINY = ("--size", "16", "--samples", "4")
# With fewer samples or repeats the measured noise at the silhouette is itself too noisy for the test of each pixel.
SOUND = ("--size", "16", "--samples", "16", "--repeats", "4", "--seed", "0")
LIBXI = "libXi.so.6: cannot open shared object file: No such file or directory"


def command(*arguments, **options):
    """The command in a process of its own, as a user starts it."""
    return subprocess.run([sys.executable, "-m", "volumetrics_addon", *map(str, arguments)], cwd=ROOT, capture_output=True,
                          text=True, timeout=120, **options)


def channels_of(path):
    """RGB of an EXR (height, width, 3), read without Blender, and the type of its pixels."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        assert sorted(channels) == ["B", "G", "R"]
        planes = [channels[name].pixels for name in "RGB"]
        return np.stack(planes, axis=-1), {plane.dtype.name for plane in planes}


def png_size(path):
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", data[16:24])


def test_exit_codes_are_what_scripts_rely_on():
    assert (OK, WORSE, USAGE, FAILED, INTERRUPTED) == (0, 1, 2, 3, 130)


# --- list and show ---------------------------------------------------------------------------------------------


def test_list(capsys):
    assert main(["list"]) == OK
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == names() and len(lines) >= 8
    assert main(["list", "--json"]) == OK
    listed = json.loads(capsys.readouterr().out)
    assert [entry["name"] for entry in listed] == names()
    assert all(set(entry) == {"name", "family", "label", "description"} for entry in listed)


@pytest.mark.parametrize("name", names())
def test_show(name, capsys):
    preset = load(name)
    assert main(["show", name]) == OK
    text = capsys.readouterr().out
    for parameter in (*preset.group.parameters, *STAGE.parameters):
        assert re.search(rf"^  {parameter.name} .*{re.escape(parameter.limits)}$", text, re.MULTILINE)

    assert main(["show", name, "--json"]) == OK
    shown = json.loads(capsys.readouterr().out)
    assert shown["parameters"] == json.loads(json.dumps(preset.parameters)) and shown["family"] == preset.family

    assert main(["show", name, "--toml"]) == OK
    assert parse(capsys.readouterr().out.encode(), Path(f"{name}.toml")) == preset


def test_show_says_what_follows(capsys):
    """Koschmieder's distance of sigma = 0.05 per metre: ln 50 / sigma. Infinity is null in JSON."""
    assert main(["show", "morning-valley"]) == OK
    assert re.search(r"^  Visibility at the base +78.2 m$", capsys.readouterr().out, re.MULTILINE)
    assert main(["show", "morning-valley", "--json", "--fog.extinction", "0"]) == OK
    quantities = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)["derived"]
    assert quantities[0] == {"label": "Visibility at the base", "value": None, "unit": "m"}


def test_show_writes_a_preset_that_the_command_line_changed(tmp_path, capsys):
    assert main(["show", "cumulus", "--toml", "--cloud.extinction", "0.02", "--cloud.albedo", "0.5,0.6,0.7",
                 "--cloud.density", "homogeneous", "--stage.exposure", "-1"]) == OK
    path = tmp_path / "mine.toml"
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    mine, original = load(path), load("cumulus")
    assert mine.parameters == {**original.parameters, "extinction": 0.02, "albedo": (0.5, 0.6, 0.7), "density": "homogeneous"}
    assert mine.stage == {**original.stage, "exposure": -1.0}
    assert main(["show", str(path)]) == OK


def test_every_declared_parameter_has_an_option_that_shows_its_limits():
    assert set(COMMANDS) == {"list", "show", "render", "verify", "tour", "plan", "integrators", "bench", "fit-phase", "table",
                             "doctor"}
    checked, commands = 0, parser("volumetrics")
    for verb in ("show", "render", "verify"):
        for group in (*FAMILIES.values(), STAGE):
            for parameter in group.parameters:
                value = parameter.default
                word = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
                option = f"--{group.name}.{parameter.name.replace('_', '-')}"
                parsed = commands.parse_args([verb, "cumulus", f"{option}={word}"])
                assert parameter.parse(getattr(parsed, f"{group.name}.{parameter.name}")) == value
                checked += 1
    assert checked >= 150


@pytest.mark.parametrize("verb", [[], *([name] for name in ("show", "render", "verify", "tour", "table", "doctor", "list",
                                                                    "integrators", "bench", "fit-phase"))])
def test_help(verb, capsys):
    assert main([*verb, "--help"]) == OK
    text = " ".join(capsys.readouterr().out.split())
    assert "usage: volumetrics" in text
    if verb in (["show"], ["render"], ["verify"]):
        for group in (*FAMILIES.values(), STAGE):
            for parameter in group.parameters:
                assert parameter.description in text
    if not verb:
        assert "exit codes" in text


def test_tables(tmp_path, capsys):
    assert main(["table", "parameters"]) == OK
    text = capsys.readouterr().out
    for group in (*FAMILIES.values(), STAGE):
        for parameter in group.parameters:
            assert f"| `{parameter.name}` |" in text and parameter.description in text
    assert main(["table", "presets", "--from", str(tmp_path)]) == USAGE
    assert "volumetrics verify all" in capsys.readouterr().err


# --- usage errors ----------------------------------------------------------------------------------------------

WRONG_USAGE = [
    ([], "required: COMMAND"), (["paint"], "invalid choice"), (["show"], "required: preset"), (["verify"], "required: preset"),
    (["list", "--loud"], "unrecognized"), (["table", "colours"], "invalid choice"),
    (["show", "cumulos"], "known: "), (["render", "cumulos"], "tea-glass"), (["verify", "tea-glass", "cumulos"], "known: "),
    (["show", "missing.toml"], "no such file"),
    (["show", "cumulus", "--glass.ior", "1.4"], "use the options --cloud.*"),
    (["verify", "tea-glass", "cumulus", "--glass.ior", "1.4"], "does not belong to cumulus"),
    (["show", "cumulus", "--cloud.extinction", "-1"], ">= 0"), (["show", "cumulus", "--cloud.extinction", "nan"], "finite"),
    (["show", "cumulus", "--cloud.extinction", "thick"], "give a number"),
    (["show", "cumulus", "--cloud.albedo", "1,1"], "three numbers"), (["show", "cumulus", "--cloud.domain", "cone"], "box"),
    (["show", "cumulus", "--stage.orders", "0"], "orders = 0"), (["show", "cumulus", "--cloud.thickness", "1"], "unrecognized"),
    (["render", "tea-glass", "--stage.field-of-view", "180"], "<= 150 deg"),
    (["render", "tea-glass", "--out", "tea.png"], "end the name with .exr"), (["render", "tea-glass", "--out", "tea"], ".exr"),
    (["render", "tea-glass", "--size", "0"], "from 1 to 8192"), (["render", "tea-glass", "--size", "8193"], "from 1 to 8192"),
    (["render", "tea-glass", "--size", "big"], "big is not allowed"), (["render", "tea-glass", "--size", "1.5"], "whole number"),
    (["render", "tea-glass", "--samples", "0"], "from 1 to"), (["render", "tea-glass", "--samples", "9" * 5000], "from 1 to"),
    (["render", "tea-glass", "--seed", "-1"], "from 0 to"), (["render", "tea-glass", "--seed", "99999999999"], "from 0 to"),
    (["render", "tea-glass", "--engine", "workbench"], "invalid choice"),
    (["verify", "tea-glass", "--repeats", "1"], "from 2 to"), (["verify", "tea-glass", "--tolerance", "0"], "positive"),
    (["verify", "tea-glass", "--tolerance", "nan"], "positive"), (["verify", "tea-glass", "--tolerance", "small"], "0.5%"),
    (["tour", "--size", "-3"], "from 1 to 8192"),
    (["render", "tea-glass", "--error", "0"], "positive fraction"), (["render", "tea-glass", "--error", "-1%"], "expected one argument"),
    (["render", "tea-glass", "--error=-1%"], "positive fraction"), (["render", "tea-glass", "--error"], "expected one argument"),
    (["render", "tea-glass", "--time"], "expected one argument"), (["render", "tea-glass", "--time", "0s"], "time above 0"),
    (["render", "tea-glass", "--time", "soon"], "such as 60, 60s"), (["render", "tea-glass", "--time", "inf"], "time above 0"),
    (["render", "tea-glass", "--error", "1%", "--samples", "8"], "--samples contradicts"),
    (["render", "tea-glass", "--time", "5s", "--samples", "8"], "--max-samples"),
    (["render", "tea-glass", "--max-samples", "8"], "belongs to --error or --time"),
    (["render", "tea-glass", "--round-samples", "8"], "belongs to --error or --time"),
    (["render", "tea-glass", "--no-denoise"], "belongs to --error or --time"),
    (["render", "tea-glass", "--no-allocate"], "belongs to --error or --time"),
    (["render", "tea-glass", "--error", "1%", "--round-samples", "8", "--max-samples", "4"], "above --max-samples 4"),
    (["render", "tea-glass", "--frame", "3"], "for .blend files"), (["render", "missing.blend"], "no such file"),
    (["render", "missing.blend", "--glass.ior", "1.4"], "is for presets"),
    # The camera looks at itself: no single value is wrong.
    (["render", "tea-glass", *TINY, "--stage.camera-location", "1,1,1", "--stage.camera-target", "1,1,1"], "direction"),
]


@pytest.mark.parametrize(("arguments", "words"), WRONG_USAGE, ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else "")
def test_wrong_usage_is_told_and_writes_nothing(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == USAGE
    output = capsys.readouterr()
    assert words in output.err and "Traceback" not in output.err and output.out == ""
    assert list(tmp_path.iterdir()) == []


def test_bad_preset_names_file_key_and_limit(tmp_path, capsys):
    path = tmp_path / "bad.toml"
    path.write_text('format = 1\nfamily = "cloud"\n[parameters]\nextinction = -0.2\n')
    for verb in ("show", "render", "verify"):
        assert main([verb, str(path)]) == USAGE
        message = capsys.readouterr().err
        for word in (str(path), "extinction = -0.2", ">= 0 and <= 100000 1/m", "bring it within"):
            assert word in message
    assert list(tmp_path.iterdir()) == [path]


# --- render ----------------------------------------------------------------------------------------------------


def test_render_writes_linear_exr_and_a_picture(tmp_path, capsys):
    out = tmp_path / "new" / "x.exr"
    assert main(["render", "tea-glass", *TINY, "--out", str(out)]) == OK
    assert str(out) in capsys.readouterr().out
    assert sorted(path.name for path in out.parent.iterdir()) == ["x.exr", "x.json", "x.png"]
    pixels, kinds = channels_of(out)
    assert pixels.shape == (16, 16, 3) and kinds == {"float32"}
    assert png_size(out.with_suffix(".png")) == (16, 16)
    # Tea on a pale ground: linear radiance of the environment, red above green above blue in the middle.
    assert np.isfinite(pixels).all() and pixels.min() >= 0.0
    assert pixels.max() == pytest.approx(0.8, rel=1e-4)
    red, green, blue = pixels[6:10, 6:10].mean(axis=(0, 1))
    assert red > 1.5 * green > 1.5 * 1.5 * blue


def test_render_follows_aspect_and_seed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    images = []
    for seed in ("0", "0", "1"):
        assert main(["render", "cobalt-block", *TINY, "--stage.aspect", "2", "--seed", seed, "--json", "--force"]) == OK
        figures = json.loads(capsys.readouterr().out)
        assert (figures["width"], figures["height"], figures["seed"]) == (16, 8, int(seed))
        assert figures["exr"] == "cobalt-block-cycles.exr" and figures["decisions"]
        images.append(channels_of(tmp_path / figures["exr"])[0])
    assert images[0].shape == (8, 16, 3)
    assert np.array_equal(images[0], images[1]) and not np.array_equal(images[0], images[2])


def test_quiet_prints_nothing(tmp_path, capfd):
    assert main(["render", "tea-glass", *TINY, "--out", str(tmp_path / "x.exr"), "--quiet"]) == OK
    assert main(["verify", "tea-glass", *SOUND, "--out", str(tmp_path), "--quiet"]) == OK
    assert tuple(capfd.readouterr()) == ("", "")


def test_what_cannot_be_written_is_found_before_the_render(tmp_path, monkeypatch, capsys):
    from volumetrics_addon.blender import render

    def never(*arguments, **options):
        raise AssertionError("the picture was rendered first")

    monkeypatch.setattr(render, "render", never)
    (tmp_path / "file").write_text("in the way")
    assert main(["render", "tea-glass", *TINY, "--out", str(tmp_path / "file" / "x.exr")]) == FAILED
    assert main(["verify", "tea-glass", *TINY, "--out", str(tmp_path / "file")]) == FAILED
    assert main(["tour", "--out", str(tmp_path / "file")]) == FAILED
    assert main(["render", "tea-glass", *TINY, "--out", "/proc/x.exr"]) == FAILED
    assert capsys.readouterr().err.count("volumetrics: ") == 4
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_failed_write_leaves_no_half_file(tmp_path, monkeypatch, capsys):
    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    assert main(["render", "tea-glass", *TINY, "--out", str(tmp_path / "x.exr")]) == FAILED
    assert "No space left" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_what_is_unchanged_is_not_rendered_again(tmp_path, monkeypatch, capsys):
    from volumetrics_addon.blender import render

    out, rendered, real = tmp_path / "x.exr", [], render.render_built
    monkeypatch.setattr(render, "render_built", lambda *a, **k: rendered.append(1) or real(*a, **k))

    def renders(*more, name="tea-glass"):
        rendered.clear()
        assert main(["render", name, *TINY, "--out", str(out), *more]) == OK
        text = capsys.readouterr().out
        assert bool(rendered) != ("unchanged, not rendered again" in text)
        return bool(rendered)

    assert renders() and not renders() and renders("--force") and not renders()
    assert renders("--seed", "1") and renders("--samples", "5") and renders("--glass.strength", "0.5") and renders("--size", "12")
    assert not renders("--size", "12")
    out.write_bytes(out.read_bytes() + b" ")  # no longer the picture that the figures are of
    assert renders("--size", "12")
    out.with_suffix(".json").write_text("{}")
    assert renders("--size", "12") and not renders("--size", "12")
    mine = tmp_path / "mine.toml"
    assert main(["show", "tea-glass", "--toml"]) == OK
    mine.write_text(capsys.readouterr().out)
    assert renders(name=str(mine)) and not renders(name=str(mine))
    assert main(["render", "tea-glass", *TINY, "--out", str(out), "--json"]) == OK
    assert json.loads(capsys.readouterr().out)["samples"] == 4


def test_render_to_an_error(tmp_path, capsys):
    out = tmp_path / "x.exr"
    arguments = ["render", "emerald-sphere", "--size", "12", "--error", "20%", "--out", str(out)]
    assert main([*arguments, "--json"]) == OK
    figures = json.loads(capsys.readouterr().out)
    assert figures["reached"] and figures["upper_bound"] <= 0.2 and figures["rounds"] >= 8 and figures["confidence"] == 0.95
    assert figures["relative_error"] <= figures["upper_bound"] and figures["noise"] <= figures["noise_upper"]
    assert figures["bias"]["upper"] < 0.2 and figures["target"] == {"error": 0.2, "seconds": None} and not figures["unchanged"]
    assert channels_of(out)[0].shape == (12, 12, 3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.exr", "x.json", "x.png"]
    assert main(arguments) == OK
    text = capsys.readouterr().out
    assert "not rendered again" in text and "with 95% confidence" in text and "against the reference" in text


def test_a_target_that_is_missed_is_exit_code_1(tmp_path, capsys):
    out = tmp_path / "x.exr"
    arguments = ["render", "emerald-sphere", "--size", "8", "--error", "2%", "--round-samples", "2", "--max-samples", "16",
                 "--out", str(out)]
    assert main(arguments) == WORSE
    text = capsys.readouterr().out
    assert "was not reached: the limit is 16 samples" in text and "times the samples" in text
    assert out.exists() and (tmp_path / ".x.exr.partial.npz").exists()  # a longer run goes on from there
    assert main(arguments) == WORSE and "not rendered again" in capsys.readouterr().out
    assert main([*arguments[:-3], "32", *arguments[-2:]]) == WORSE
    assert "going on from" in (text := capsys.readouterr().out) and "16 x 2 samples" in text
    short = ["render", "emerald-sphere", "--size", "8", "--time", "1s", "--out", str(tmp_path / "y.exr")]
    assert main(short) == OK and "it is measured from 10 s on" in capsys.readouterr().out
    assert not (tmp_path / ".y.exr.partial.npz").exists()


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    """A .blend file made with Blender's start-up scene."""
    path = tmp_path_factory.mktemp("blend") / "start.blend"
    code = ("import bpy; bpy.ops.wm.read_factory_settings(); s = bpy.context.scene; s.render.engine = 'CYCLES'; "
            "s.render.resolution_x, s.render.resolution_y, s.render.resolution_percentage = 40, 20, 50; s.cycles.samples = 3; "
            f"bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})")
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    return path


def test_render_a_blend_file(blend, tmp_path, capsys):
    out = tmp_path / "x.exr"
    assert main(["render", str(blend), "--out", str(out), "--json"]) == OK
    figures = json.loads(capsys.readouterr().out)
    assert (figures["width"], figures["height"], figures["samples"], figures["engine"]) == (20, 10, 3, "cycles")
    assert figures["blend"] == str(blend) and "adaptive sampling off" not in {d["effect"] for d in figures["decisions"]}
    assert main(["render", str(blend), "--out", str(out)]) == OK and "not rendered again" in capsys.readouterr().out
    assert main(["render", str(blend), "--out", str(out), "--size", "16", "--error", "10%"]) == OK
    text = capsys.readouterr().out
    assert "16 x 8" in text and "against itself with four times the samples" in text
    assert channels_of(out)[0].shape == (8, 16, 3)
    assert main(["render", str(blend), "--out", str(out), "--plan", "--without", "persistent data", "--json"]) == OK
    planned = json.loads(capsys.readouterr().out)["decisions"]
    assert "light tree" in {d["rule"] for d in planned} and "persistent data" not in {d["rule"] for d in planned}
    assert main(["render", str(blend), "--out", str(out), "--plan", "1%", "--error", "20%", "--size", "8", "--json"]) == OK
    targeted = json.loads(capsys.readouterr().out)["decisions"]
    assert "light tree" in {d["rule"] for d in targeted} and "adaptive sampling off" in {d["effect"] for d in targeted}
    assert main(["render", str(blend), "--out", str(out), "--without", "light tree"]) == USAGE
    assert "give both for a .blend file" in capsys.readouterr().err
    bad = tmp_path / "bad.blend"
    bad.write_bytes(b"not a blend file")
    assert main(["render", str(bad), "--out", str(tmp_path / "y.exr")]) == USAGE
    assert "bad.blend cannot be opened" in capsys.readouterr().err and not (tmp_path / "y.exr").exists()


def test_a_plan_sets_the_samples_of_eevee(tmp_path, capsys):
    """64 in the file; where samples are asked for, those are taken."""
    path, out = tmp_path / "haze.blend", tmp_path / "x.exr"
    code = (f"import bpy; scene = bpy.context.scene; tree = bpy.data.materials['Material'].node_tree;"
            f"shader = tree.nodes.new('ShaderNodeVolumeScatter'); end = next(n for n in tree.nodes if n.type == 'OUTPUT_MATERIAL');"
            f"tree.links.remove(end.inputs['Surface'].links[0]); tree.links.new(shader.outputs[0], end.inputs['Volume']);"
            f"bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})")
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    arguments = ["render", str(path), "--engine", "eevee", "--out", str(out), "--size", "16", "--plan", "--json"]
    assert main(arguments) == OK
    figures = json.loads(capsys.readouterr().out)
    assert figures["samples"] == 8 and "froxels" in {decision["rule"] for decision in figures["decisions"]}
    assert main([*arguments, "--samples", "2"]) == OK
    assert json.loads(capsys.readouterr().out)["samples"] == 2


# --- verify ----------------------------------------------------------------------------------------------------


def test_verify_states_the_error_and_writes_the_evidence(tmp_path, capsys):
    assert main(["verify", "tea-glass", *SOUND, "--tolerance", "5%", "--out", str(tmp_path), "--json"]) == OK
    (result,) = json.loads(capsys.readouterr().out)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "tea-glass-cycles.exr", "tea-glass-cycles.json", "tea-glass-cycles.png", "tea-glass-reference.exr"]
    assert sorted(result["files"].values()) == sorted(str(path) for path in tmp_path.iterdir())
    assert result["passed"] and result["tolerance"] == 0.05 and result["repeats"] == 4
    written = json.loads((tmp_path / "tea-glass-cycles.json").read_text(encoding="utf-8"))
    assert written.items() <= result.items()
    error = written["comparison"]["mean_relative_error"]
    low, high = written["comparison"]["mean_relative_interval"]
    assert low <= error <= high and abs(error) < 0.01
    # The stated error is that of the files.
    render, reference = (channels_of(tmp_path / f"tea-glass-{kind}.exr")[0].astype(float) for kind in ("cycles", "reference"))
    assert render.mean() / reference.mean() - 1.0 == pytest.approx(error, abs=1e-6)
    width, height = png_size(tmp_path / "tea-glass-cycles.png")
    assert width > 3 * 300 and height > 300

    assert main(["table", "presets", "--from", str(tmp_path)]) == USAGE  # the other results are missing
    assert f"{names()[0]}-cycles.json" in capsys.readouterr().err


def test_verify_fails_above_the_tolerance_and_still_writes(tmp_path, capsys):
    """Noise cannot hit the reference to nine digits."""
    assert main(["verify", "tea-glass", *SOUND, "--tolerance", "1e-9", "--out", str(tmp_path)]) == WORSE
    output = capsys.readouterr().out
    assert "WORSE than 1e-07%" in output and "mean error" in output
    assert len(list(tmp_path.iterdir())) == 4


def test_verify_says_when_pixels_fail_although_the_mean_is_right(tmp_path, monkeypatch, capsys):
    from volumetrics_addon.compare import statistics

    monkeypatch.setattr(statistics, "REQUIRED_PASS_FRACTION", 1.1)
    assert main(["verify", "tea-glass", *SOUND, "--tolerance", "50%", "--out", str(tmp_path)]) == WORSE
    assert "WORSE: too few pixels pass" in capsys.readouterr().out


# --- integrators and bench --------------------------------------------------------------------------------------


def test_integrators_are_listed_with_their_bias(capsys):
    assert main(["integrators"]) == OK
    text = capsys.readouterr().out
    assert main(["integrators", "--json"]) == OK
    listed = json.loads(capsys.readouterr().out)
    assert len(listed) >= 17 and text.count("bias: ") == len(listed)
    for entry in listed:
        assert entry["name"] in text and entry["summary"] in text and entry["bias"] in text
        assert len(entry["settings"]) >= 5


def test_bench_measures_charts_and_resumes(tmp_path, capsys):
    arguments = ["bench", "street-lamp", "--rivals", "single_scattering,cycles,dielectric", "--size", "6", "--out", str(tmp_path)]
    assert main(arguments) == OK
    text = capsys.readouterr().out
    assert "dielectric does not apply" in text and "| street-lamp | Cycles |" in text
    assert {path.name.split("-")[0] for path in tmp_path.iterdir()} == {"bench.csv", "bench.png", "street", "summary.md", "truth"}
    assert png_size(tmp_path / "street-lamp.png") == (1280, 720)
    rows = (tmp_path / "bench.csv").read_text()
    assert rows.count("cycles") >= 5 and rows.count("single_scattering") >= 5
    assert main([*arguments, "--json"]) == OK
    assert (tmp_path / "bench.csv").read_text() == rows
    assert len(json.loads(capsys.readouterr().out)["rows"]) == rows.count("\n") - 1


def test_bench_without_matplotlib_keeps_the_measurements(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["bench", "glass", "--rivals", "dielectric", "--size", "4", "--out", str(tmp_path)]) == OK
    assert "pip install matplotlib" in capsys.readouterr().out
    assert (tmp_path / "summary.md").exists() and not list(tmp_path.glob("*.png"))


@pytest.mark.parametrize("arguments, words", [
    (["bench", "moon"], "street-lamp"), (["bench", "--rivals", "renderman"], "ray_marching"), (["bench", "--limit", "0"], "above 0"),
])
def test_bench_refuses_what_it_does_not_know(arguments, words, tmp_path, capsys):
    assert main([*arguments, "--out", str(tmp_path / "new")]) == USAGE
    assert words in capsys.readouterr().err and not (tmp_path / "new").exists()


# --- doctor and a machine without Blender -----------------------------------------------------------------------


def test_doctor_here(capfd):
    assert main(["doctor"]) == OK
    text = capfd.readouterr().out
    for name in ("Python", "Blender (bpy)", "Cycles", "EEVEE"):
        assert re.search(rf"^(ok     |without) {re.escape(name)}: ", text, re.MULTILINE)
    assert main(["doctor", "--json"]) == OK
    results = json.loads(capfd.readouterr().out)
    assert all(check["ok"] for check in results if check["required"])
    assert all(bool(check["remedy"]) != check["ok"] for check in results)


def test_library_that_a_message_names_is_looked_up(monkeypatch):
    monkeypatch.setattr(doctor, "missing_libraries", list)
    for library, package in doctor.LIBRARIES.items():
        remedy = doctor.import_remedy(ImportError(f"{library}: cannot open shared object file", name="bpy"))
        assert remedy.startswith("apt-get install -y ") and package in remedy.split()
    assert "install the shared library" in doctor.import_remedy(ImportError("libodd.so.1: cannot open shared object file"))
    assert "pip install bpy" in doctor.import_remedy(ModuleNotFoundError("No module named 'bpy'", name="bpy"))
    assert doctor.import_remedy(ModuleNotFoundError("No module named 'numpy'", name="numpy")).endswith("pip install numpy")


def test_missing_libraries_are_found_and_named(monkeypatch):
    real = doctor.ctypes.CDLL

    def without_x(name, *arguments, **options):
        if name in ("libXi.so.6", "libSM.so.6"):
            raise OSError(f"{name}: cannot open shared object file: No such file or directory")
        return real(name, *arguments, **options)

    monkeypatch.setattr(doctor.ctypes, "CDLL", without_x)
    missing = doctor.missing_libraries()
    assert {"libXi.so.6", "libSM.so.6"} <= set(missing)
    assert {"libxi6", "libsm6", "libgl1-mesa-dri"} <= set(doctor.install_command(missing).split())
    check = next(check for check in doctor.checks() if check.name == "system libraries")
    assert not check.ok and check.required and "libXi.so.6" in check.detail and "libxi6" in check.remedy


@pytest.fixture(scope="module")
def without_blender(tmp_path_factory):
    """Environment in which importing bpy fails as on a slim Debian."""
    folder = tmp_path_factory.mktemp("fake")
    (folder / "bpy.py").write_text(f"raise ImportError({LIBXI!r}, name='bpy')\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


def test_doctor_without_blender_names_the_package(without_blender):
    done = command("doctor", env=without_blender)
    assert done.returncode == FAILED and done.stderr == ""
    assert f"MISSING Blender (bpy): {LIBXI}" in done.stdout
    remedies = [line for line in done.stdout.splitlines() if "apt-get install" in line]
    assert remedies and "libxi6" in remedies[-1].split()
    done = command("doctor", "--json", env=without_blender)
    failed = {check["name"]: check for check in json.loads(done.stdout) if check["required"] and not check["ok"]}
    assert "libxi6" in failed["Blender (bpy)"]["remedy"]


def test_what_needs_no_blender_works_without(without_blender):
    done = command("list", env=without_blender)
    assert done.returncode == OK and len(done.stdout.splitlines()) == len(names())
    done = command("show", "cumulus", "--toml", env=without_blender)
    assert done.returncode == OK and parse(done.stdout.encode(), Path("cumulus.toml")) == load("cumulus")


@pytest.mark.parametrize("verb", ["render", "verify"])
def test_what_needs_blender_tells_what_is_missing(verb, without_blender, tmp_path):
    done = command(verb, "tea-glass", *TINY, "--out", tmp_path / "out.exr", env=without_blender)
    assert done.returncode == FAILED and done.stdout == "" and "Traceback" not in done.stderr
    assert LIBXI in done.stderr and "libxi6" in done.stderr and "volumetrics doctor" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_without_bpy_at_all_pip_is_the_remedy(tmp_path):
    (tmp_path / "bpy.py").write_text("raise ModuleNotFoundError(\"No module named 'bpy'\", name='bpy')\n")
    done = command("doctor", env={**os.environ, "PYTHONPATH": str(tmp_path)})
    assert done.returncode == FAILED and "pip install bpy" in done.stdout


# --- as a process ----------------------------------------------------------------------------------------------


def test_standard_output_is_json_and_nothing_else(tmp_path):
    """Through a pipe, where Blender's own messages would end up in the same stream."""
    done = command("render", "tea-glass", *TINY, "--out", tmp_path / "x.exr", "--json", "--engine-output")
    assert done.returncode == OK
    assert json.loads(done.stdout)["exr"] == str(tmp_path / "x.exr")
    assert done.stderr  # what the engine printed
    done = command("doctor", "--json")
    assert done.returncode == OK and json.loads(done.stdout)


def test_script_for_a_blender_without_the_extension():
    done = subprocess.run([sys.executable, ROOT / "scripts" / "volumetrics.py", "--", "show", "cumulos"], capture_output=True,
                          text=True, timeout=60)
    assert done.returncode == USAGE and "known: " in done.stderr


def test_interrupted_render_to_an_error_goes_on_to_the_same_pixels(tmp_path):
    """Ctrl-C in the engine, where no Python runs; the rounds that follow then make what an uninterrupted run does.

    Below ten seconds no bias is measured, which here would take longer than the picture.
    """
    arguments = ["render", "emerald-sphere", "--size", "32", "--error", "0.0001%", "--round-samples", "128"]
    out, checkpoint = tmp_path / "x.exr", tmp_path / ".x.exr.partial.npz"
    process = subprocess.Popen([sys.executable, "-m", "volumetrics_addon", *arguments, "--time", "9.9", "--out", str(out)], cwd=ROOT,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        deadline = time.monotonic() + 60
        while not checkpoint.exists():
            assert time.monotonic() < deadline and process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == INTERRUPTED and b"the same command goes on" in errors and b"Traceback" not in errors
    assert list(tmp_path.iterdir()) == [checkpoint]
    with np.load(checkpoint) as stored:
        rounds = int(stored["count"])
    limit = str(128 * (rounds + 3))
    resumed = command(*arguments, "--max-samples", limit, "--out", out, "--json")
    whole = command(*arguments, "--max-samples", limit, "--time", "9.9", "--out", tmp_path / "whole.exr", "--json")
    figures = [json.loads(done.stdout) for done in (resumed, whole)]
    assert [f["resumed_rounds"] for f in figures] == [rounds, 0] and figures[0]["rounds"] == figures[1]["rounds"] == rounds + 3
    assert np.array_equal(channels_of(out)[0], channels_of(tmp_path / "whole.exr")[0])


def test_interrupt_stops_a_render_and_leaves_nothing(tmp_path):
    out, temporary = tmp_path / "out", tmp_path / "temporary"
    temporary.mkdir()
    process = subprocess.Popen(
        [sys.executable, "-m", "volumetrics_addon", "render", "cumulus", "--size", "64", "--samples", "100000", "--out",
         str(out / "x.exr")],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "TMPDIR": str(temporary)})
    try:
        deadline = time.monotonic() + 60
        while not list(temporary.glob("volumetrics*")):  # the folder that the engine renders into
            assert time.monotonic() < deadline and process.poll() is None
            time.sleep(0.05)
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        start = time.monotonic()
        _, errors = process.communicate(timeout=20)
        assert time.monotonic() - start < 5.0  # measured 0.1 s
    finally:
        process.kill()
    assert process.returncode == INTERRUPTED
    assert b"interrupted" in errors and b"Traceback" not in errors
    assert list(out.iterdir()) == [] and list(temporary.iterdir()) == []


@pytest.mark.parametrize("options, expected", [([], (True, True)), (["--no-denoise"], (False, True)),
                                               (["--no-allocate"], (True, False))])
def test_a_render_to_an_error_is_denoised_and_allocated_unless_that_is_switched_off(options, expected, monkeypatch, tmp_path):
    from volumetrics_addon.blender import converge

    asked = []

    def render(*arguments, **options):
        asked.append((options["denoise"], options["allocate"]))
        raise ValueError("far enough")

    monkeypatch.setattr(converge, "render", render)
    assert main(["render", "tea-glass", "--error", "5%", "--out", str(tmp_path / "x.exr"), *options]) != 0
    assert asked == [expected]
