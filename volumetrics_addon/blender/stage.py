# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be rendered over and over with other seeds, samples and sizes: a preset's scene, or a user's own."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ..compare.allocation import Region
from ..parameters.preset import Preset
from ..plan.model import CYCLES, EEVEE, Decision
from ..plan.rules import sample_settings
from ..scene import assemble
from ..scene.model import Scene
from . import compat, observe, render, settings

# A user's scene keeps its own settings but for these: denoising, stamps and dither are no light, and the picture is that of the
# scene's camera. Rounds are independent and equally long too, hence no adaptive sampling and no time limit.
PICTURE_SETTINGS = {"render.use_sequencer": False, "render.use_stamp": False, "render.dither_intensity": 0.0,
                    "render.use_multiview": False}
ENGINE_SETTINGS = {CYCLES: {"cycles.use_denoising": False, "cycles.use_animated_seed": False}, EEVEE: {}}
ROUND_SETTINGS = {CYCLES: {"cycles.use_adaptive_sampling": False, "cycles.time_limit": 0.0,
                           "cycles.sampling_pattern": "TABULATED_SOBOL"}, EEVEE: {}}
SHADOWS_FULL = re.compile(r"Shadow buffer full.*\((\d+) / (\d+)\)")  # EEVEE's own words, in 4.5 and 5.2
BORDER = ("render.use_border", "render.use_crop_to_border", "render.border_min_x", "render.border_max_x", "render.border_min_y",
          "render.border_max_y")


@dataclass
class Stage:
    """One Blender scene, or three in grey for the channels, and how to render them."""

    engine: str
    scenes: list[bpy.types.Scene]
    first_included: bool = False  # see plan.rules.sample_settings
    quiet: bool = True
    interrupted: str = render.INTERRUPTED  # said on Ctrl-C
    decisions: list[Decision] = field(default_factory=list)
    heard: bool = False  # whether anything was, of what the engine prints
    shadow_pages: tuple[int, int] = (0, 0)  # the most that EEVEE asked for where they were too few, and how many there are

    @property
    def missing_shadows(self) -> str:
        """What EEVEE says of shadows that it had no memory for; empty where all fitted or nothing was heard."""
        wanted, there = self.shadow_pages
        return f"EEVEE had memory for {there} of {wanted} pages of shadow maps: shadows and the light of lamps in media may be missing; " \
               "a larger Shadow Pool, a smaller picture or wider cells of the volume may help" if wanted else ""

    @property
    def divisible(self) -> bool:
        """Whether rectangles of the picture may be rendered by themselves: not where the compositor looks beyond a pixel, or the
        scene has a border of its own."""
        return self.engine == CYCLES and not any(_composited(scene) or scene.render.use_border for scene in self.scenes)

    @property
    def learns(self) -> bool:
        """Whether a render's first samples tell its others where to scatter, see plan.effort.learned_samples."""
        return self.engine == CYCLES and compat.current().learns and any(
            medium.substance.albedo > 0.0 for scene in self.scenes for medium in observe.scene(scene, survey=False).media)

    def shoot(self, width: int, height: int, samples: int, seed: int = 0, regions: Sequence[Region] = ()) -> np.ndarray:
        """An image (height, width, 3), float64; ``regions``, which cover it, have their own samples. Raises RenderError."""
        if not regions:
            return self._shoot(width, height, samples, seed)
        image = np.empty((height, width, 3))
        kept = [{path: settings.get(scene, path) for path in BORDER} for scene in self.scenes]
        try:
            for one in regions:
                edges = one.left, one.top, one.right, one.bottom
                image[one.top:one.bottom, one.left:one.right] = self._shoot(width, height, one.samples, seed, edges)
        finally:
            for scene, before in zip(self.scenes, kept):
                settings.restore(scene, before)
        return image

    def _shoot(self, width: int, height: int, samples: int, seed: int,
               region: tuple[int, int, int, int] | None = None) -> np.ndarray:
        parts, lines = [], []
        for scene in self.scenes:
            settings.apply(scene, sample_settings(self.engine, samples, self.first_included))
            parts.append(render.render_built(scene, width, height, seed=seed, quiet=self.quiet, interrupted=self.interrupted,
                                             region=region, heard=lines)[0])
        self.heard |= bool(lines)
        self.shadow_pages = max([self.shadow_pages, *((int(found[1]), int(found[2])) for found in map(SHADOWS_FULL.search, lines) if found)])
        return render.together(parts)


def _composited(scene: bpy.types.Scene) -> bool:
    tree = compat.present_compositing_tree(scene) if scene.render.use_compositing else None
    return tree is not None and any(node.bl_idname not in compat.PLAIN_COMPOSITING for node in tree.nodes)


@contextmanager
def of_preset(preset: Preset, scene: Scene, engine: str, seed: int = 0, quiet: bool = True, paths: float = 0.0,
              without: Collection[str] = ()) -> Iterator[Stage]:
    """A preset's stage, as ``verify.scene_of`` makes its Scene, for pictures of so many camera paths; removed at the end."""
    bodies = assemble.bodies(preset.family, preset.parameters, scene.volumes)
    with render.staged(scene, bodies, preset.label, engine, 1, seed=seed, paths=paths, aspect=preset.stage["aspect"],
                       without=without) as (plan, built):
        yield Stage(engine, built, plan.compositor_fog, quiet, decisions=plan.decisions)


@contextmanager
def of_scene(scene: bpy.types.Scene, engine: str, quiet: bool = True, changes: Mapping[str, Any] | None = None,
             prepare: Callable[[bpy.types.Scene], None] | None = None, rounds: bool = True) -> Iterator[Stage]:
    """A user's scene as its file has it, but for what pictures need, and ``rounds`` of them; its settings come back at the end.

    ``changes``: settings by path over its own. ``prepare`` is called with the scene before that, to apply a plan.
    Raises ValueError without a camera.
    """
    if scene.camera is None:
        raise ValueError(f"scene {scene.name!r} has no camera; add one and make it the active camera")
    if prepare:
        prepare(scene)
    wanted = {"render.engine": "CYCLES" if engine == CYCLES else compat.current().eevee, **PICTURE_SETTINGS,
              **ENGINE_SETTINGS[engine], **(ROUND_SETTINGS[engine] if rounds else {}), **(changes or {})}
    samples = sample_settings(engine, 1)
    kept = {path: settings.get(scene, path) for path in (
        *samples, "cycles.seed", "render.filepath", "render.use_file_extension", "render.resolution_x", "render.resolution_y",
        "render.resolution_percentage")}
    image = scene.render.image_settings
    image_before = [(name, getattr(image, name)) for name, _ in compat.current().exr_settings] + [
        (name, getattr(image, name)) for name in ("color_mode", "color_depth", "exr_codec", "color_management")]
    layers = [(layer, layer.samples) for layer in scene.view_layers]
    tree = compat.present_compositing_tree(scene)
    files = [(node, node.mute) for node in tree.nodes if node.bl_idname == "CompositorNodeOutputFile"] if tree else []
    before = settings.apply(scene, wanted)
    decisions = [Decision("rounds", what, why) for path, what, why in (
        ("cycles.use_adaptive_sampling", "adaptive sampling off", "the error is measured from renders that are independent and equally long"),
        ("cycles.use_denoising", "denoising off", "the picture is what the engine's samples say"))
        if before.get(path)]
    try:
        image.color_management = "FOLLOW_SCENE"
        for layer, _ in layers:
            layer.samples = 0  # it would count instead of the scene's
        for node, _ in files:
            node.mute = True  # unfinished pictures are not the user's
        yield Stage(engine, [scene], quiet=quiet, decisions=decisions)
    finally:
        for layer, count in layers:
            layer.samples = count
        for node, mute in files:
            node.mute = mute
        settings.restore(scene, kept)
        settings.restore(scene, before)
        for name, value in image_before:
            setattr(image, name, value)


def size_of(scene: bpy.types.Scene, size: int | None = None) -> tuple[int, int]:
    """Width and height of the scene's pictures, or of ones of its shape whose longer side is ``size``."""
    render_settings = scene.render
    width, height = (max(1, round(side * render_settings.resolution_percentage / 100.0))
                     for side in (render_settings.resolution_x, render_settings.resolution_y))
    return (width, height) if size is None else scaled_size(width, height, size)


def scaled_size(width: int, height: int, size: int) -> tuple[int, int]:
    """The shape with ``size`` pixels along its longer side."""
    longer = max(width, height)
    return max(1, round(width * size / longer)), max(1, round(height * size / longer))
