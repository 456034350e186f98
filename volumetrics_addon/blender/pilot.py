# SPDX-License-Identifier: GPL-3.0-or-later
"""A pilot: small pictures of a user's scene in Cycles that tell how noisy a large one will be."""

from __future__ import annotations

import math

import bpy
import numpy as np

from ..plan.model import CYCLES
from ..plan.observed import Noise, Observed
from ..plan.tuning import is_marched
from . import stage

PICTURES = 2
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
    aspect = scene.render.resolution_x / scene.render.resolution_y
    width = max(1, round(math.sqrt(pixels * aspect)))
    height = max(1, round(pixels / width))
    with stage.of_scene(scene, CYCLES, changes={"render.use_compositing": False, "render.use_persistent_data": True}) as on:
        pictures = np.stack([on.shoot(width, height, samples, seed + index) for index in range(PICTURES)])
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
