# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine settings by path: apply, remember what was there, restore."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy


def _owner(root: Any, path: str) -> tuple[Any, str]:
    """Where a path ends: attributes, and view layers as ``view_layers[NAME]``. Raises AttributeError and KeyError."""
    if path.startswith("view_layers["):
        name, _, path = path.removeprefix("view_layers[").rpartition("].")
        root = root.view_layers[name]
    *parents, name = path.split(".")
    for parent in parents:
        root = getattr(root, parent)
    return root, name


def get(scene: bpy.types.Scene, path: str) -> Any:
    owner, name = _owner(scene, path)
    return getattr(owner, name)


def apply(scene: bpy.types.Scene, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Set every path below the scene; returns the values that were there. Raises AttributeError on an unknown path."""
    before = {}
    for path, value in settings.items():
        owner, name = _owner(scene, path)
        before[path] = getattr(owner, name)
        setattr(owner, name, value)
    return before


def restore(scene: bpy.types.Scene, before: Mapping[str, Any], applied: Mapping[str, Any] | None = None) -> None:
    """Bring back remembered values; where ``applied`` is given, a value the user has changed since is left alone."""
    for path, value in before.items():
        owner, name = _owner(scene, path)
        if applied is not None and path in applied and not same(getattr(owner, name), applied[path]):
            continue
        setattr(owner, name, value)


def same(a: Any, b: Any) -> bool:
    """Equal as properties hold them: floats are float32."""
    if isinstance(a, float) and isinstance(b, (int, float)):
        return abs(a - b) <= 1e-6 * max(abs(a), abs(b))
    return a == b
