# SPDX-License-Identifier: GPL-3.0-or-later
"""A pilot: small pictures of a user's scene in Cycles that tell how noisy a large one will be, and some in EEVEE that tell
what finer cells would bring and whether its shadows fit into their memory."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import bpy
import numpy as np

from ..plan.model import CYCLES, EEVEE
from ..plan.observed import Cells, Noise, Observed
from ..plan.tuning import Advice, is_marched
from . import stage

PICTURES = 2
# EEVEE, measured on eleven scenes of 480 x 270 pixels against 256 samples: pictures of one and of four samples differ by d, and n
# samples from eight on have noise of 0.2 to 0.4 d / sqrt(n), on one 0.5. With four samples its cells are off up to twice what they are with many.
FEW, NOISE, CELLS = 4, 0.45, 2.0
SHARE = 1.0 / 64.0  # of the camera paths that the picture itself is expected to take, at most
FEWEST_PIXELS, MOST_PIXELS = 256, 4096  # of a picture of the pilot: fewer tell nothing, more tell no more
NOISIEST, PIECE = 0.02, 4  # of the pixels; pixels across a piece of the picture
FEWEST_SAMPLES, MOST_SAMPLES = 16, 64  # of a pixel of it: few miss what is rare and bright, such as caustics


def size(observed: Observed, marched: bool = False) -> tuple[int, int] | None:
    """Pixels and samples of a pilot's pictures; None where it would not pay, or nothing would follow from it.

    ``marched``: whether textured media will be marched through. Otherwise they may have octrees, which each picture builds.
    """
    if observed.engine != CYCLES or not observed.settings.get("cycles.use_adaptive_sampling"):
        return None
    if not (marched or is_marched(observed)) and any(medium.substance.textured for medium in observed.media):
        return None
    paths = SHARE * observed.paths / PICTURES
    samples = int(min(paths / FEWEST_PIXELS, MOST_SAMPLES))
    return (int(min(paths / samples, MOST_PIXELS)), samples) if samples >= FEWEST_SAMPLES else None


def measure(scene: bpy.types.Scene, pixels: int, samples: int, seed: int = 0) -> Noise:
    """The noise of the scene as it is set, from pictures of so many pixels and samples without its compositing.

    Variance of one sample: that of the pictures, times ``samples``, without the noisiest pixels, whose light is rare and seen by luck:
    rather too little than too much. Raises ValueError without a camera, RenderError when the engine
    writes no image.
    """
    shape = _shape(scene, pixels)
    with stage.of_scene(scene, CYCLES, changes={"render.use_compositing": False, "render.use_persistent_data": True}) as on:
        pictures = np.stack([on.shoot(*shape, samples, seed + index) for index in range(PICTURES)])
    variance = np.sort(pictures.var(axis=0, ddof=1).mean(axis=-1), axis=None)
    kept = variance[:math.ceil((1.0 - NOISIEST) * variance.size)]
    return Noise(samples * float(kept.sum() / variance.size), float(pictures.sum(axis=-1).mean()), _pieces(samples * pictures))


def _pieces(sums: np.ndarray) -> tuple[float, ...]:
    """Of squares of PIECE pixels the variance of one sample over the brightness, 0 where it is dark. ``sums`` of the samples of each
    picture: their variance over their mean is that of one sample."""
    rows, columns = (size // PIECE * PIECE for size in sums.shape[1:3])
    variance, brightness = (plane[:rows, :columns].reshape(rows // PIECE, PIECE, columns // PIECE, PIECE).mean(axis=(1, 3))
                            for plane in (sums.var(axis=0, ddof=1).mean(axis=-1), sums.mean(axis=0).sum(axis=-1)))
    return tuple(np.divide(variance, brightness, out=np.zeros_like(brightness), where=brightness > 0.0).ravel().tolist())


def cells(scene: bpy.types.Scene, pixels: float, advice: Sequence[Advice]) -> Cells | None:
    """How far EEVEE's cells are off those that the advice gives the scene, and the noise of a sample with these, in pictures of so many
    pixels. None where these cells' shadow maps do not fit into their memory, by EEVEE's own word, or nothing is heard of it.

    Pictures of four samples with both tell the cells, since they take the same places in each pixel; one of a single sample tells the
    noise, see NOISE. Nothing is changed. Raises ValueError without a camera, RenderError when the engine writes no image.
    """
    changes = {change.path: change.value for found in advice for change in found.changes if change.owner == "scenes"}
    shape = _shape(scene, pixels)  # before the stage sets another
    with stage.of_scene(scene, EEVEE) as on:
        on.shoot(8, 8, 1)  # compiles the shaders
        own, own_seconds = _timed(on, *shape, FEW)
    with stage.of_scene(scene, EEVEE, changes=changes) as on:
        (single, first), (finer, seconds) = (_timed(on, *shape, samples) for samples in (1, FEW))
    of_sample = max(0.0, seconds - first) / (FEW - 1)
    fixed = max(0.0, first - of_sample)
    level = float(finer.mean())
    if not on.heard or on.missing_shadows or not level > 0.0:
        return None
    error, change = (float(np.sqrt(np.mean((picture - finer) ** 2))) / level for picture in (own, single))
    return Cells(error / CELLS, NOISE * change, max(0.0, own_seconds - fixed) / FEW, of_sample)


def _timed(on: stage.Stage, width: int, height: int, samples: int) -> tuple[np.ndarray, float]:
    start = time.perf_counter()
    return on.shoot(width, height, samples), time.perf_counter() - start


def _shape(scene: bpy.types.Scene, pixels: float) -> tuple[int, int]:
    """Width and height of so many pixels in the shape of the scene's pictures."""
    width = max(1, round(math.sqrt(pixels * scene.render.resolution_x / scene.render.resolution_y)))
    return width, max(1, round(pixels / width))
