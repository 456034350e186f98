# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's zip: Blender's own tool accepts it, it holds what it needs, and it works under its other name."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("build_extension", ROOT / "scripts" / "build_extension.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The zip, built as the documentation says."""
    out = tmp_path_factory.mktemp("dist") / "new"
    done = subprocess.run([sys.executable, ROOT / "scripts" / "build_extension.py", "--out", out], capture_output=True,
                          text=True, check=True, cwd=out.parent)
    path = Path(done.stdout.splitlines()[-1])
    assert path.parent == out and "Success" in done.stdout
    return path


def test_name_and_manifest(package):
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert package.name == f"volumetrics-{manifest['version']}.zip"
    assert manifest["version"] == project["version"]
    assert manifest["license"] == [f"SPDX:{project['license']}"]
    with zipfile.ZipFile(package) as zipped:
        assert zipped.read("blender_manifest.toml") == (ROOT / "blender_manifest.toml").read_bytes()


def test_contents_are_the_sources_and_nothing_else(package):
    with zipfile.ZipFile(package) as zipped:
        assert zipped.testzip() is None
        inside = {name: zipped.read(name) for name in zipped.namelist() if not name.endswith("/")}
    sources = {path.relative_to(ROOT / "volumetrics_addon").as_posix(): path
               for pattern in ("*.py", "*.npz") for path in (ROOT / "volumetrics_addon").rglob(pattern)}
    sources |= {f"presets/{path.name}": path for path in (ROOT / "presets").glob("*.toml")}
    sources |= {name: ROOT / name for name in ("blender_manifest.toml", "LICENSE")}
    assert set(inside) == set(sources)
    assert len(sources) > 50 and sum(name.startswith("presets/") for name in inside) >= 8
    for name, path in sources.items():
        assert inside[name] == path.read_bytes(), name


def test_permissions_name_what_is_used():
    """Files are read and written; there is no network and no subprocess in the package."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert list(manifest["permissions"]) == ["files"]
    for path in (ROOT / "volumetrics_addon").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for word in (r"import subprocess\b", r"import socket\b", "urllib", "requests", r"eval\(", r"exec\(", "pickle"):
            assert not re.search(word, text), f"{path} has {word}"


def test_installed_extension_works_under_its_other_name(package, tmp_path):
    """As an extension the package is bl_ext.user_default.volumetrics, and its presets lie inside it."""
    installed = tmp_path / "extensions" / "user_default" / "volumetrics"
    with zipfile.ZipFile(package) as zipped:
        zipped.extractall(installed)
    code = """
import json, sys
import bpy
import addon_utils  # there once bpy is
name = "bl_ext.user_default.volumetrics"
before = len(bpy.data.objects)
assert addon_utils.enable(name, default_set=True) is not None
settings = bpy.context.window_manager.volumetrics
settings.preset = "window-light"
bpy.ops.volumetrics.add()
items = sys.modules[name + ".blender.items"]
(item,) = items.items(bpy.context.scene)
added = len(bpy.data.objects) - before
bpy.ops.volumetrics.remove(item=item.name)
presets = sys.modules[name + ".parameters.preset"]
code = sys.modules[name + ".ui"]._run_command(["show", "cumulus", "--quiet"])
result = {"added": added, "left": len(bpy.data.objects) - before, "presets": presets.names(), "code": code,
          "folder": str(presets.directory()), "foreign": [m for m in sys.modules if m.startswith("volumetrics_addon")]}
addon_utils.disable(name, default_set=True)
result["gone"] = not hasattr(bpy.types.WindowManager, "volumetrics")
print("RESULT" + json.dumps(result))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, cwd=tmp_path,
                          env={**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)})
    assert "RESULT" in done.stdout, done.stdout + done.stderr
    result = json.loads(done.stdout.partition("RESULT")[2])
    assert result["added"] >= 3 and result["left"] == 0 and result["code"] == 0 and result["gone"]
    assert result["presets"] == sorted(path.stem for path in (ROOT / "presets").glob("*.toml"))
    assert result["folder"] == str(installed / "presets") and result["foreign"] == []


def test_without_blender_the_remedy_is_named(script, monkeypatch):
    monkeypatch.setattr(sys, "path", [])
    with pytest.raises(FileNotFoundError, match="pip install bpy"):
        script.extension_tool()


def test_a_manifest_that_blender_refuses_stops_the_build(script, monkeypatch, tmp_path, capfd):
    real = script.stage

    def broken(folder):
        real(folder)
        (folder / "blender_manifest.toml").write_text('id = "volumetrics"\n')

    monkeypatch.setattr(script, "stage", broken)
    with pytest.raises(subprocess.CalledProcessError):
        script.build(tmp_path)
    assert list(tmp_path.iterdir()) == []
