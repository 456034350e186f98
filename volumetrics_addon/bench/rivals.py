# SPDX-License-Identifier: GPL-3.0-or-later
"""The rivals of the benchmark: every integrator, and the two engines over their own settings."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..plan.model import CYCLES, EEVEE
from ..reference import select
from ..scene.describe import describe_scene
from ..scene.model import Scene

Setting = Mapping[str, Any]

# The narrowest filters that the engines have: their images too are taken at the centres of the pixels.
# Cycles' box filter is a pixel wide whatever its width says.
CENTRES = {CYCLES: {"cycles.pixel_filter_type": "GAUSSIAN", "cycles.filter_width": 0.01}, EEVEE: {"render.filter_size": 0.0}}
ENGINE_SETTINGS: dict[str, tuple[Setting, ...]] = {
    CYCLES: tuple({"samples": samples} for samples in (1, 4, 16, 64, 256, 1024)),
    EEVEE: tuple({"samples": samples, "eevee.volumetric_tile_size": tile, "eevee.volumetric_samples": slices}
                 for samples, tile, slices in ((1, "16", 32), (1, "8", 64), (4, "8", 64), (8, "4", 64), (16, "2", 64),
                                               (16, "2", 128))),
}


class RivalFailed(RuntimeError):
    """A rival that applies delivered no image: an engine that this machine cannot run."""


@dataclass(frozen=True)
class Shot:
    """One image with its wall time, and the error that the rival itself states (relative; None: it states none)."""

    image: np.ndarray
    seconds: float
    evaluations: int
    stated_error: float | None


class IntegratorRival:
    """An integrator of the package, one image at pixel centres."""

    def __init__(self, name: str):
        self.name = name
        self.module = select.load(name)
        self.settings: tuple[Setting, ...] = self.module.SETTINGS

    def applies(self, scene: Scene) -> str:
        return self.module.applies(scene)

    def shoot(self, scene: Scene, width: int, height: int, setting: Setting, seed: int) -> Shot:
        start = time.perf_counter()
        result = self.module.render(scene, width, height, **{"repeats": 1, "strata": 0, "seed": seed, **setting})
        seconds = time.perf_counter() - start
        error = np.sqrt(np.mean(result.error_estimate**2))
        mean = result.image.mean()
        return Shot(result.image, seconds, result.evaluations, float(error / mean) if np.isfinite(error) and mean > 0 else None)


class EngineRival:
    """Cycles or EEVEE with the plan's settings, from the Scene alone. The time holds building, synchronising, reading."""

    def __init__(self, name: str):
        self.name = name
        self.settings = ENGINE_SETTINGS[name]

    def applies(self, scene: Scene) -> str:
        try:
            describe_scene(scene)
        except ValueError as error:
            return str(error)
        return ""

    def shoot(self, scene: Scene, width: int, height: int, setting: Setting, seed: int) -> Shot:
        from ..blender.render import RenderError, render_scene

        own = dict(setting)
        samples = own.pop("samples")
        try:
            rendered = render_scene(scene, describe_scene(scene), "Benchmark", self.name, width, height, samples, seed=seed,
                                    settings=CENTRES[self.name] | own)
        except RenderError as error:
            raise RivalFailed(str(error)) from error
        return Shot(rendered.images[0], rendered.seconds, width * height * samples, None)


Rival = IntegratorRival | EngineRival


def rival(name: str) -> Rival:
    """The rival of that name. Raises ValueError for an unknown one."""
    if name in ENGINE_SETTINGS:
        return EngineRival(name)
    if name not in select.NAMES:
        raise ValueError(f"there is no rival {name!r}; the rivals are {', '.join(names())}")
    return IntegratorRival(name)


def names() -> tuple[str, ...]:
    return (*select.NAMES, *ENGINE_SETTINGS)
