# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray marching in uniform or jittered steps between the front and back depth of the media.

Every ray is cut at the front depth of the first medium and the back depth of the last one, or the surface before it,
and divided into ``steps`` equal steps. Each is lit once, in its middle, or, with ``jitter``, at an independent uniform
position in it, which turns the bands of few steps into noise that repeats average (Perlin and Hoffert, Hypertexture,
SIGGRAPH 1989; stratified offsets as in Toth and Umenhoffer, Real-time volumetric lighting in participating media, 2009).
The step's transmittance is integrated, not sampled: see ``marching``. Light reaches the samples through the occluders and
through the media, by closed-form optical depth where there is one and ``light_steps`` midpoints where there is not.
"""

from __future__ import annotations

import numpy as np

from ..scene.model import Scene
from . import marching
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = ("Error of the steps: fourfold smaller for twice as many where light is smooth, twofold at shadows and cones; jitter "
        "keeps the second order inside each step. " + marching.SINGLE_BIAS)
SETTINGS = tuple({"steps": steps} for steps in (4, 8, 16, 32, 64, 128, 256))

applies = marching.applies


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, steps: int = 32,
           jitter: bool = False, light_steps: int = marching.LIGHT_STEPS, seed: int = 0,
           progress: Progress | None = None) -> Result:
    """Image of the scene in single scattering, with ``steps`` samples a ray.

    Each of ``repeats`` images averages strata^2 jittered rays per pixel (``strata`` 0: one through its centre). Raises
    ValueError when the integrator does not apply (see ``applies``) and for fewer than one step.
    """
    marching.refuse("ray_marching", applies(scene))
    marching.counted("steps", steps, "use 16 for a preview, 128 for a reference")
    marching.counted("light_steps", light_steps, "use 8 for a preview, 64 for a reference")

    def radiance(origin: Array, direction: Array, rng: np.random.Generator) -> tuple[Array, Array, int]:
        hit, index = marching.first_hit(scene, origin, direction)
        column = marching.march(scene, origin, direction, hit, steps, light_steps, jitter=rng if jitter else None)
        value, doubt = marching.composed(scene, origin, direction, hit, index, column, rng, light_steps)
        return value, doubt, steps * len(value)

    return render_rays("ray_marching", radiance, scene, width, height, repeats=repeats, strata=strata, seed=seed,
                       random=jitter or max(scene.environment) > 0.0, progress=progress,
                       tile=marching.rays_at_once(steps))
