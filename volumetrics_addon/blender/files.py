# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's own .blend file: open one of its scenes, save it under another name."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..plan.model import CYCLES
from . import compat


def open_scene(path: Path, name: str | None = None, engine: str | None = None) -> bpy.types.Scene:
    """Open the file without running its scripts; the scene of that name, or the one that the file shows.

    With ``engine`` the scene is set to it. Raises ValueError where the file has no such scene, OSError where it cannot be read.
    """
    path = Path(path).absolute()
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}; give the name of a .blend file")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise OSError(f"{path} cannot be opened: {str(error).strip()}; is it a .blend file?") from error
    found = bpy.context.scene if name is None else bpy.data.scenes.get(name)
    if found is None:
        raise ValueError(f"{path.name} has no scene {name!r}; it has {', '.join(repr(scene.name) for scene in bpy.data.scenes)}")
    if engine is not None:
        found.render.engine = "CYCLES" if engine == CYCLES else compat.current().eevee
    return found


def save(path: Path) -> None:
    """Write the open file under another name; the file it came from stays. Raises OSError where it cannot be written."""
    path = Path(path).absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, relative_remap=True)
    except RuntimeError as error:
        raise OSError(f"{path} cannot be written: {str(error).strip()}") from error
