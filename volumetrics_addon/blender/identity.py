# SPDX-License-Identifier: GPL-3.0-or-later
"""What determines the pixels of a picture, as a digest: equal digests, equal pixels."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import bpy

from ..parameters.preset import Preset

# Rooms of the package that have no say in a render's pixels.
_WITHOUT_PIXELS = {"ui", "cli", "bench", "compare"}


def digest(**facts: Any) -> str:
    """Of plain values."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()


def of_file(path: str | Path) -> str:
    """Of a file's content; empty where there is no such file."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


@cache
def of_package() -> str:
    """Of the package's code and data: finer than its version, which only a release changes."""
    root = Path(__file__).resolve().parent.parent
    files = sorted(path for path in root.rglob("*") if path.is_file() and path.suffix not in (".pyc", ".toml")
                   and path.relative_to(root).parts[0] not in _WITHOUT_PIXELS)
    return digest(files=[(path.relative_to(root).as_posix(), of_file(path)) for path in files])


def _common(engine: str | None, width: int | None, height: int | None, seed: int) -> dict[str, Any]:
    return {"engine": engine, "width": width, "height": height, "seed": seed, "blender": bpy.app.version_string,
            "build": bpy.app.build_hash.decode(), "package": of_package()}


def of_preset(preset: Preset, engine: str, width: int, height: int, seed: int) -> str:
    """Of everything but the number of samples; files that a preset names count by their content."""
    files = {parameter.name: of_file(preset.parameters[parameter.name]) for parameter in preset.group.parameters
             if parameter.kind == "path" and preset.parameters[parameter.name]}
    return digest(family=preset.family, parameters=dict(preset.parameters), stage=dict(preset.stage),
                  props=[dict(prop) for prop in preset.props], files=files, **_common(engine, width, height, seed))


def of_blend(path: Path, engine: str | None, frame: int | None, size: int | None, seed: int) -> str:
    """Of a .blend file's content and what is asked of it, None where that is the file's own; its ``externals`` are apart."""
    return digest(blend=of_file(path), frame=frame, **_common(engine, size, None, seed))


def externals() -> dict[str, str]:
    """Digests, by path, of the files that the open .blend uses: pictures, libraries, volumes, caches."""
    return of_files(bpy.utils.blend_paths(absolute=True, packed=False, local=False))


def of_files(paths: Iterable[str]) -> dict[str, str]:
    return {path: of_file(path) for path in sorted(set(paths))}
