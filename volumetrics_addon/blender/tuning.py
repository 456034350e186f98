# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans for a user's own scene: find the advice, apply it, and bring back every value, also after saving and loading.

What was changed is remembered on the very datablock, as a custom property: it survives renaming, and goes where the block goes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any

import bpy

from ..plan import tuning
from ..plan.model import EEVEE
from ..plan.observed import Cells, Noise, Observed
from ..plan.tuning import Advice, Change
from . import observe, settings
from . import pilot as pilots

NOISE_RULE = "noise threshold"
KEY = "volumetrics_plan"
EXCLUDES = "excludes"


def plan(scene: bpy.types.Scene, error: float = tuning.TARGET, without: Collection[str] = (), *,
         samples: int | None = None, pixels: float | None = None, pilot: bool = False, again: bool = True) -> list[Advice]:
    """The advice for the scene as it is now, within the relative error; see ``plan.tuning.tune``. Nothing is changed.

    ``samples`` of the picture that is to be rendered, and ``pixels``: its size, where these are not those of the scene's own
    settings. With ``pilot`` its noise is measured where that pays, with what the plan changes: small pictures are rendered, and in
    EEVEE large ones of few samples with finer cells; raises RenderError when the engine writes none. Unless ``again``, what the last
    pilot has measured of the scene is taken where all that is observed of it, and what would be changed, are the same.
    """
    observed = observe.scene(scene, samples=samples, pixels=pixels)
    advice = tuning.tune(observed, error, without)
    if not pilot or scene.camera is None:
        return advice
    if observed.engine == EEVEE:
        # where noise and time are no matter: what a pilot would have to try
        trial = tuning.tune(replace(observed, cells=Cells(math.inf, 0.0, 1.0, 0.0)), error, without)
        if trial == advice:
            return advice
        cells = _measured(scene, observed, trial, again, lambda: pilots.cells(scene, observed.pixels, trial))
        return tuning.tune(replace(observed, cells=cells), error, without)
    marched = any(change.path == "cycles.volume_biased" for found in advice for change in found.changes)
    if NOISE_RULE in without or not (size := pilots.size(observed, marched)):
        return advice
    noise = _measured(scene, observed, advice, again, lambda: _noise(scene, advice, size))
    return tuning.tune(replace(observed, noise=noise), error, without)


_last: tuple[Any, Noise | Cells | None] | None = None  # what a pilot was rendered for, and what it has told


def _measured(scene: bpy.types.Scene, observed: Observed, advice: Sequence[Advice], again: bool,
              measure: Callable[[], Noise | Cells | None]) -> Noise | Cells | None:
    global _last
    what = scene.session_uid, observed, [change for found in advice for change in found.changes]
    if again or _last is None or _last[0] != what:
        _last = what, measure()
    return _last[1]


def _noise(scene: bpy.types.Scene, advice: Sequence[Advice], size: tuple[int, int]) -> Noise:
    """Of the scene with the advice, or with the plan that it has."""
    planned = is_applied(scene)
    try:
        if not planned:
            apply(scene, advice)
        return pilots.measure(scene, *size)
    finally:
        if not planned:
            restore(scene)


def apply(scene: bpy.types.Scene, advice: Sequence[Advice]) -> None:
    """Make the changes of the advice; what an earlier plan has changed is brought back first."""
    restore(scene)
    for change in (change for entry in advice for change in entry.changes):
        block = _block(scene, change)
        if block is None:
            continue
        if change.path == EXCLUDES:
            _exclude(block, change.value)
            continue
        path = _path(change)
        before = _set(block, path, change.value)
        _remember(block, path, before[path], settings.get(block, path))


def restore(scene: bpy.types.Scene) -> int:
    """Bring back what a plan has changed in the scene; values that the user has changed since stay. Returns how many came back."""
    restored = 0
    for block in list(_touched(scene)):
        mine = json.loads(block[KEY])
        for path, (before, applied) in mine.items():
            if path == EXCLUDES:
                _include_again(block, before)
            else:
                try:
                    if not settings.same(settings.get(block, path), applied):
                        continue
                    _set(block, path, before)
                except (AttributeError, KeyError):  # a view layer that is gone
                    continue
            restored += 1
        del block[KEY]
    return restored


def is_applied(scene: bpy.types.Scene) -> bool:
    return next(_touched(scene), None) is not None


def _touched(scene: bpy.types.Scene) -> Iterator[bpy.types.ID]:
    """Datablocks of the scene that remember a change."""
    if KEY in scene:
        yield scene
    if scene.world is not None and KEY in scene.world:
        yield scene.world
    seen = set()
    for candidate in scene.objects:
        data = candidate.data if candidate.type == "LIGHT" else None
        for block in (candidate, data, *(slot.material for slot in candidate.material_slots)):
            if block is not None and KEY in block and block.as_pointer() not in seen:
                seen.add(block.as_pointer())
                yield block


def _block(scene: bpy.types.Scene, change: Change) -> bpy.types.ID | None:
    """The datablock that a change is made in; changes of a view layer are the scene's."""
    if change.owner in ("scenes", "view_layers"):
        return scene
    if change.owner == "lights":
        lamp = bpy.data.objects.get((change.name, None))
        return lamp.data if lamp else None
    return getattr(bpy.data, change.owner).get((change.name, None))


def _path(change: Change) -> str:
    return f"view_layers[{change.name}].{change.path}" if change.owner == "view_layers" else change.path


def _set(block: bpy.types.ID, path: str, value: Any) -> dict[str, Any]:
    """What was there. Cycles' own properties of a material tell nobody that they changed, and renders with persistent data go by what
    they are told."""
    before = settings.apply(block, {path: value})
    block.update_tag()
    return before


def _remember(block: bpy.types.ID, path: str, before: Any, applied: Any) -> None:
    mine = json.loads(block[KEY]) if KEY in block else {}
    mine[path] = (before, applied)
    block[KEY] = json.dumps(mine)


def _exclude(lamp: bpy.types.Object, names: Sequence[str]) -> None:
    """Let the lamp light everything but these objects, by a collection of its own that holds them as excluded."""
    receivers = bpy.data.collections.new(f"{lamp.name} lights all but")
    lamp.light_linking.receiver_collection = receivers
    for name in names:
        candidate = bpy.data.objects.get((name, None))
        if candidate is not None:
            receivers.objects.link(candidate)
    for entry in receivers.collection_objects:
        entry.light_linking.link_state = "EXCLUDE"
    receivers[KEY] = "{}"
    _remember(lamp, EXCLUDES, None, list(names))


def _include_again(lamp: bpy.types.Object, before: None) -> None:
    receivers = lamp.light_linking.receiver_collection
    if receivers is not None and KEY in receivers:
        lamp.light_linking.receiver_collection = None
        if receivers.users == 0:
            bpy.data.collections.remove(receivers)
