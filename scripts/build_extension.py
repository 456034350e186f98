# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the extension zip and have Blender's own tool validate it.

    python scripts/build_extension.py [--out dist]

Blender's tool wants the manifest beside ``__init__.py``, so the package, the manifest, the licence and the presets are
staged in one folder first. The tool comes with the bpy module.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SKIP = shutil.ignore_patterns("__pycache__", "*.pyc")


def extension_tool() -> Path:
    """Blender's blender_ext.py. Raises FileNotFoundError when the bpy module is not installed."""
    for folder in map(Path, sys.path):
        found = sorted((folder / "bpy").glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
        if found:
            return found[-1]
    raise FileNotFoundError("blender_ext.py comes with the bpy module; install it with: python3 -m pip install bpy")


def stage(folder: Path) -> None:
    shutil.copytree(ROOT / "volumetrics_addon", folder, ignore=SKIP)
    shutil.copytree(ROOT / "presets", folder / "presets", ignore=SKIP)
    for name in ("blender_manifest.toml", "LICENSE"):
        shutil.copy2(ROOT / name, folder / name)


def build(out: Path) -> Path:
    """The path of the built and validated zip. Raises subprocess.CalledProcessError when Blender's tool refuses it."""
    tool = [sys.executable, str(extension_tool())]
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary) / "volumetrics"
        stage(source)
        subprocess.run([*tool, "build", "--source-dir", str(source), "--output-dir", str(out)], check=True)
    package = max(out.glob("volumetrics-*.zip"), key=lambda path: path.stat().st_mtime)
    subprocess.run([*tool, "validate", str(package)], check=True)
    return package


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--out", type=Path, default=ROOT / "dist")
    print(build(arguments.parse_args().out))
