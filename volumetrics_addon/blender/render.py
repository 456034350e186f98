# SPDX-License-Identifier: GPL-3.0-or-later
"""Headless rendering of a built scene to linear 32-bit EXR, once per seed."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..parameters.preset import Preset
from ..plan.model import CYCLES, Plan
from ..plan.rules import bakes_light, explain_representation, light_resolution
from ..plan.rules import plan as make_plan
from ..reference import light_balance, light_grid
from ..reference.light_balance import Balance
from ..reference.light_grid import LightGrid
from ..scene import assemble
from ..scene.assemble import bodies
from ..scene.body import Body
from ..scene.channels import CHANNELS, channel, channel_body
from ..scene.model import Scene
from . import build, compat


LIGHT_PATHS = 64 * 32  # of baked light: for each of its voxels, times the voxels along its longest side
DIMMED = "EEVEE dims neither what lights surfaces through media nor the sky in them"
INTERRUPTED = "interrupted; nothing half-written is left"


class RenderError(RuntimeError):
    """The engine did not deliver an image."""


@dataclass(frozen=True)
class Rendered:
    """Repeats of one render: ``images`` (k, height, width, 3), row 0 at the top; seconds for all of them."""

    images: np.ndarray
    plan: Plan
    seconds: float


def read_image(path: Path) -> np.ndarray:
    """Linear pixels (height, width, 3) of an image file, row 0 at the top, through Blender's own reader."""
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        if width == 0 or height == 0:
            raise RenderError(f"{path} holds no pixels")
        flat = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(flat)
        return flat.reshape(height, width, image.channels)[::-1, :, :3].astype(np.float64)
    finally:
        bpy.data.images.remove(image)


def write_exr(path: Path, pixels: np.ndarray) -> None:
    """Linear (height, width, 3) float32 EXR, row 0 at the top; the file appears whole or not at all."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new("Volumetrics write", width, height, alpha=False, float_buffer=True)
    scene = bpy.data.scenes.new("Volumetrics write")
    try:
        compat.select_exr(scene.render.image_settings)
        image.colorspace_settings.name = "Linear Rec.709"
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :3] = pixels[::-1]
        image.pixels.foreach_set(rgba.ravel())
        with whole_file(path) as partial:
            image.save_render(str(partial), scene=scene)
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.images.remove(image)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name to write to beside ``path``; it becomes ``path`` at the end, or is deleted when the writing fails."""
    path = Path(path).absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def silenced(enabled: bool, heard: list[str] | None = None) -> Iterator[None]:
    """Keep what the engine prints, which no Blender option silences, from the terminal; its lines are added to ``heard``."""
    if not enabled:
        yield
        return
    saved = [os.dup(descriptor) for descriptor in (1, 2)]
    with tempfile.TemporaryFile() as file:
        try:
            for descriptor in (1, 2):
                os.dup2(file.fileno(), descriptor)
            yield
        finally:
            for descriptor, copy in zip((1, 2), saved):
                os.dup2(copy, descriptor)
                os.close(copy)
            if heard is not None:
                file.seek(0)
                heard += file.read().decode(errors="replace").splitlines()


@contextmanager
def _interruptible(folder: str, message: str) -> Iterator[None]:
    """Ctrl-C ends the process at once, with exit code 130.

    Python runs signal handlers only between its own instructions, and an engine returns to Python when its picture is
    done. A thread waits for the signal instead; it removes the temporary folders, since nothing else will. The handler itself
    does nothing: an exception in the Python of Cycles' add-on leaves it without a session, and Blender renders with none.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    errors = os.dup(2)  # as it was before the engine was silenced

    def watch() -> None:
        while received := os.read(reader, 1):
            if received[0] != signal.SIGINT:
                continue
            for leftover in (folder, bpy.app.tempdir):
                shutil.rmtree(leftover, ignore_errors=True)
            os.write(errors, f"\nvolumetrics: {message}\n".encode())
            os._exit(130)

    watcher = threading.Thread(target=watch, daemon=True)
    handler_before = signal.signal(signal.SIGINT, lambda number, frame: None)
    wakeup_before = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    watcher.start()
    try:
        yield
    finally:
        # None is Blender's own, which Python cannot bring back.
        signal.signal(signal.SIGINT, signal.default_int_handler if handler_before is None else handler_before)
        signal.set_wakeup_fd(wakeup_before)
        os.close(writer)
        watcher.join()
        os.close(reader)
        os.close(errors)


def render(preset: Preset, scene: Scene, engine: str, width: int, height: int, samples: int, *, seed: int = 0,
           repeats: int = 1, quiet: bool = True, without: Collection[str] = (),
           progress: Callable[[float], None] | None = None) -> Rendered:
    """Render the preset's stage ``repeats`` times with consecutive seeds (EEVEE is deterministic: one repeat is made).

    Raises RenderError when the engine writes no image.
    """
    rendered = render_scene(scene, bodies(preset.family, preset.parameters, scene.volumes), preset.label, engine, width, height,
                            samples, seed=seed, repeats=repeats, quiet=quiet, without=without, progress=progress)
    _explain_representation(preset, engine, width * height * samples * repeats, rendered.plan)
    return rendered


def plan_of(preset: Preset, scene: Scene, engine: str, width: int, height: int, samples: int, without: Collection[str] = ()) -> Plan:
    """The plan by which ``render`` would show the preset, with rules switched off by name."""
    plan = make_plan(scene, bodies(preset.family, preset.parameters, scene.volumes), engine, samples,
                     has_null_scattering=compat.current().volume_biased, paths=width * height * samples, without=without)
    _explain_representation(preset, engine, width * height * samples, plan)
    for volume in scene.volumes:
        if engine != CYCLES and not plan.compositor_fog and (reason := bakes_light(scene, volume, preset.parameters)):
            plan.decide("baked light", f"{light_resolution(volume, preset.parameters)} voxels along the longest side", reason)
    if not any(decision.rule == "baked light" for decision in plan.decisions):
        _balance(scene, bodies(preset.family, preset.parameters, scene.volumes), plan, width / height, 0)
    return plan


def _explain_representation(preset: Preset, engine: str, paths: int, plan: Plan) -> None:
    if engine == CYCLES and preset.parameters.get("representation") == "automatic":
        shaped = assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)
        explain_representation(shaped.volumes, preset.parameters, paths, plan)


def _baked_light(scene: Scene, bodies: Sequence[Body], plan: Plan, seed: int) -> dict[int, LightGrid]:
    """The scattered light of the bodies that EEVEE shows by it, by their index."""
    result = {}
    for index, body in enumerate(bodies):
        volume, values = body.volumes[0], body.values
        if plan.engine != CYCLES and (reason := bakes_light(scene, volume, values)):
            resolution = light_resolution(volume, values)
            light = light_grid.bake(scene, scene.volumes.index(volume), resolution, samples=max(8, LIGHT_PATHS // resolution),
                                    seed=seed, smoothing=light_grid.SMOOTHING)
            result[index] = light
            plan.decide("baked light", f"{' x '.join(map(str, light.values.shape[:3]))} voxels of scattered light, noise "
                        f"{light.noise:.0%} in a voxel, {light.error:.1%} in their mean, in {light.seconds:.1f} s", reason)
    return result


def _balance(scene: Scene, bodies: Sequence[Body], plan: Plan, aspect: float, seed: int) -> Balance | None:
    """What EEVEE's lights are dimmed to, where they shine through media that do not dim them.

    A body that asks for EEVEE's own scattering gets it as it is.
    """
    if plan.engine == CYCLES or plan.compositor_fog or not plan.may("dimmed light") or light_balance.applies(scene) or any(
            body.values.get("eevee_light") == "scatter" for body in bodies):
        return None
    balance = light_balance.balance(scene, aspect, seed)
    shares = [min(share) for share in balance.surfaces + (balance.sky,)]
    plan.decide("dimmed light", f"lamps and sky at down to {min(shares):.0%} of their light", DIMMED)
    return balance


def render_scene(scene: Scene, bodies: Sequence[Body], label: str, engine: str, width: int, height: int, samples: int, *,
                 settings: Mapping[str, Any] | None = None, seed: int = 0, repeats: int = 1, quiet: bool = True,
                 without: Collection[str] = (), progress: Callable[[float], None] | None = None) -> Rendered:
    """Render a Scene whose volumes are these bodies; ``settings`` by path go over those of the plan, ``without`` names rules of it
    that are switched off.

    Raises RenderError when the engine writes no image.
    """
    if engine != CYCLES:
        repeats = 1
    start = time.perf_counter()
    report = progress or (lambda share: None)
    with staged(scene, bodies, label, engine, samples, settings=settings, seed=seed, paths=width * height * samples,
                aspect=width / height, without=without) as (plan, built):
        parts = [render_built(one, width, height, seed=seed, repeats=repeats, quiet=quiet,
                              progress=lambda share, index=index: report((index + share) / len(built)))
                 for index, one in enumerate(built)]
    return Rendered(together(parts), plan, time.perf_counter() - start)


@contextmanager
def staged(scene: Scene, bodies: Sequence[Body], label: str, engine: str, samples: int, *,
           settings: Mapping[str, Any] | None = None, seed: int = 0, paths: float = 0.0, aspect: float = 1.0,
           without: Collection[str] = ()) -> Iterator[tuple[Plan, list[bpy.types.Scene]]]:
    """The plan and the Blender scene of a Scene, or three scenes in grey where the plan renders its channels apart; they are
    removed at the end."""
    plan = make_plan(scene, bodies, engine, samples, has_null_scattering=compat.current().volume_biased, paths=paths,
                     without=without)
    plan.settings.update(settings or {})
    with build.temporary():
        if plan.channels_apart:
            yield plan, [build.build(grey, [channel_body(body, index) for body in bodies], plan, label,
                                     balance=_balance(grey, bodies, plan, aspect, seed))
                         for index, grey in ((index, channel(scene, index)) for index in CHANNELS)]
        else:
            baked = {} if plan.compositor_fog else _baked_light(scene, bodies, plan, seed)
            balance = None if baked else _balance(scene, bodies, plan, aspect, seed)
            yield plan, [build.build(scene, bodies, plan, label, baked, balance)]


def together(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Images (..., 3) of a stage's scenes: the only one, or the grey ones of red, green and blue as one."""
    return parts[0] if len(parts) == 1 else np.stack([grey.mean(axis=-1) for grey in parts], axis=-1)


def render_built(built: bpy.types.Scene, width: int, height: int, *, seed: int = 0, repeats: int = 1, quiet: bool = True,
                 progress: Callable[[float], None] | None = None, interrupted: str = INTERRUPTED,
                 region: tuple[int, int, int, int] | None = None, heard: list[str] | None = None) -> np.ndarray:
    """Images (repeats, height, width, 3) of a Blender scene, with consecutive seeds in Cycles; ``interrupted`` is said on Ctrl-C.

    ``region``: its pixels (left, top, right, bottom) alone, row 0 at the top, as they are in the whole picture; the scene's own
    border is then replaced. ``heard`` takes the lines that the engine prints where it is ``quiet``. Raises RenderError when the engine
    writes no image.
    """
    images = []
    render = built.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.use_file_extension = True
    compat.select_exr(render.image_settings)
    if region:
        # a quarter of a pixel inside: edges are float32, and are cut to whole pixels
        left, top, right, bottom = region
        render.use_border = render.use_crop_to_border = True
        render.border_min_x, render.border_max_x = (left + 0.25) / width, (right + 0.25) / width
        render.border_min_y, render.border_max_y = (height - bottom + 0.25) / height, (height - top + 0.25) / height
    with tempfile.TemporaryDirectory(prefix="volumetrics") as folder:
        for repeat in range(repeats):
            built.cycles.seed = seed + repeat
            path = Path(folder) / f"{repeat}.exr"
            render.filepath = str(path)
            with _interruptible(folder, interrupted), silenced(quiet, heard):
                bpy.ops.render.render(write_still=True, scene=built.name)
            if not path.exists():
                raise RenderError(f"{render.engine} wrote no image; run 'volumetrics doctor' to see what is missing")
            images.append(read_image(path))
            if progress:
                progress((repeat + 1) / repeats)
    return np.stack(images)
