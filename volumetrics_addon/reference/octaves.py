# SPDX-License-Identifier: GPL-3.0-or-later
"""Multiple scattering as octaves of single scattering with less extinction, less scattering and a rounder phase function.

Octave n of ``octaves`` is ray-marched with

    sigma_s b^n,  tau_light a^n,  p(c^n g),

where ``attenuation`` a <= ``contribution`` b and ``eccentricity`` c lie in [0, 1]: light that has been scattered more
often goes deeper, is weaker and has forgotten its direction (Wrenninge, Kulla and Lundqvist, Oz: the great and volumetric,
SIGGRAPH 2013 talks, where the extinction is reduced towards the light; Hillaire, Physically based sky, atmosphere and
cloud rendering in Frostbite, SIGGRAPH 2016 course, who asks for a <= b). Towards the camera every octave is attenuated by
the whole extinction, as in the cloud renderers that ship the method. Phase functions without g are mixed with the
isotropic one, which gives the same mean cosine. One octave is single scattering. The environment, for which the sources
have no octaves, is scattered once.

Measured on a ball without absorption under a sun, 8 octaves of a = b = c = 1/2 against path tracing of 256 orders, radiance
averaged over the image (in brackets: of single scattering), sun behind the camera, to the side, and opposite:

    sigma_t R = 2, g = 0      0.97 (0.41)    1.05 (0.37)    1.20 (0.27)
    sigma_t R = 2, g = 0.8    2.06 (0.16)    1.29 (0.14)    0.58 (0.43)
    sigma_t R = 8, g = 0      0.57 (0.23)    0.73 (0.23)    1.31 (0.01)
    sigma_t R = 8, g = 0.8    0.53 (0.04)    0.45 (0.04)    0.22 (0.02)

with a relative RMSE over the pixels of 0.11 to 0.25, 0.46 to 1.1, 0.44 to 0.48 and 0.55 to 0.84.
"""

from __future__ import annotations

import numpy as np

from ..physics import checks
from ..scene.model import Scene
from . import marching
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = ("An approximation of multiple scattering without bound: on a ball of optical radius 2 to 8 the radiance came out "
        "at 0.57 to 1.3 times the truth where g is 0 and at 0.22 to 2.1 times where it is 0.8; single scattering at 0.01 to "
        "0.43.")
SETTINGS = tuple({"octaves": octaves, "steps": steps}
                 for octaves, steps in ((1, 8), (2, 8), (4, 16), (8, 32), (8, 64), (8, 128)))

applies = marching.applies


def factors(octaves: int, attenuation: float, contribution: float, eccentricity: float) -> marching.Octaves:
    """(b^n, a^n, c^n) of each octave n. ValueError for fewer than one octave, values beyond [0, 1] and a > b."""
    marching.counted("octaves", octaves, "1 is single scattering, 8 are usual")
    for name, value in (("attenuation", attenuation), ("contribution", contribution), ("eccentricity", eccentricity)):
        checks.fraction(name, value)
    if attenuation > contribution:
        raise ValueError(f"attenuation must be <= contribution {contribution}, got {attenuation}: octaves that go deeper "
                         "than they fade create light; lower the attenuation or raise the contribution")
    return tuple((contribution**n, attenuation**n, eccentricity**n) for n in range(octaves))


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, octaves: int = 8, steps: int = 32,
           attenuation: float = 0.5, contribution: float = 0.5, eccentricity: float = 0.5,
           light_steps: int = marching.LIGHT_STEPS, seed: int = 0, progress: Progress | None = None) -> Result:
    """Image of the scene, its multiple scattering approximated by ``octaves`` marched in ``steps``.

    The stated error is that of the steps, not of the approximation. ``repeats``, ``strata`` and ``light_steps`` are those of
    ray_marching. Raises ValueError when the integrator does not apply (see ``applies``), and see ``factors``.
    """
    marching.refuse("octaves", applies(scene))
    marching.counted("steps", steps, "use 16 for a preview, 128 for a reference")
    marching.counted("light_steps", light_steps, "use 8 for a preview, 64 for a reference")
    series = factors(octaves, attenuation, contribution, eccentricity)

    def radiance(origin: Array, direction: Array, rng: np.random.Generator) -> tuple[Array, Array, int]:
        hit, index = marching.first_hit(scene, origin, direction)
        column = marching.march(scene, origin, direction, hit, steps, light_steps, series)
        value, doubt = marching.composed(scene, origin, direction, hit, index, column, rng, light_steps)
        return value, doubt, steps * len(value)

    return render_rays("octaves", radiance, scene, width, height, repeats=repeats, strata=strata, seed=seed,
                       random=max(scene.environment) > 0.0, progress=progress, tile=marching.rays_at_once(steps))
