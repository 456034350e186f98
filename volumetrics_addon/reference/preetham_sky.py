# SPDX-License-Identifier: GPL-3.0-or-later
"""Preetham's analytic sky for rays above the horizon, and the ground lit by the sun alone: no integration at all.

The turbidity is the scene's own, (Rayleigh + Mie) / Rayleigh by the green vertical optical depths, cut to the model's
range, or given. The sky is scaled from the real sun's illuminance to the scene's sun.
"""

from __future__ import annotations

import numpy as np

from ..physics.preetham import MAX_LUMINOUS_EFFICACY, SOLAR_ILLUMINANCE, preetham_sky
from ..scene.model import RayleighPhase, Scene
from . import planet
from .result import Progress, Result

Array = np.ndarray

BIAS = ("A fit to the Earth's sky at turbidities from 2 to 10, whatever the scene's air: against clear air its mean was 2.2 times "
        "too bright at noon and 6.9 times at sunset, most of it near the horizon.")
SETTINGS = ({"turbidity": None}, {"turbidity": 2.0}, {"turbidity": 2.5}, {"turbidity": 3.0}, {"turbidity": 4.0})

CLEAREST, HAZIEST = 2.0, 10.0
# Of its own radiance: against air of turbidity 1.1 in all orders the model is too bright 2.2 times with the sun at 60
# degrees, 2.2 (turbidity 4) to 6.9 times (2) at 2 degrees.
MODEL_ERROR = 0.85


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    view = planet.planet_of(scene)
    if isinstance(view, str):
        return view
    radius = np.linalg.norm(np.subtract(scene.camera.position, view.center))
    if radius - view.planet.radius > max(component.scale_height for component in view.planet.components):
        return "the camera is above the air that the model is made for"
    if np.subtract(scene.camera.position, view.center) @ view.toward < 0.0:
        return "the sun is below the horizon"
    return ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 1, strata: int = 0, seed: int = 0,
           turbidity: float | None = None, progress: Progress | None = None) -> Result:
    """Image of Preetham's sky; ``turbidity`` in [2, 10], None takes the scene's own.

    There is no resolution to compare with: the error estimate of a pixel is MODEL_ERROR of its radiance. Raises ValueError
    when the integrator does not apply.
    """
    if reason := applies(scene):
        raise ValueError(f"preetham_sky does not apply: {reason}; use sky_tables")
    view = planet.required_view(scene, "preetham_sky")
    chosen = turbidity_of(scene) if turbidity is None else turbidity

    def value(origin: Array, direction: Array) -> tuple[Array, int]:
        return radiance(view, chosen, origin, direction)

    return planet.image(scene, width, height, "preetham_sky", value, value, repeats=repeats, strata=strata, seed=seed,
                        progress=progress, missing=MODEL_ERROR)


def turbidity_of(scene: Scene) -> float:
    """Share of all components' green vertical optical depth in the molecules', cut to the model's range."""
    molecules, total = 0.0, 0.0
    for volume in scene.volumes:
        depth = volume.medium.sigma_t[1] * volume.medium.density.scale_height
        total += depth
        molecules += depth if isinstance(volume.medium.phase, RayleighPhase) else 0.0
    return min(max(total / molecules, CLEAREST), HAZIEST) if molecules > 0.0 else HAZIEST


def radiance(view: planet.View, turbidity: float, origin: Array, direction: Array) -> tuple[Array, int]:
    """Radiance (n, 3) along rays (n, 3), and their number."""
    rays = view.rays(origin, direction)
    value = view.reflected(rays, view.direct)
    above = ~rays.hits & (rays.length > 0.0)
    zenith = np.arccos(np.clip(rays.mu_s[above], 0.0, 1.0))
    sky = preetham_sky(np.maximum(rays.mu[above], 0.0), rays.nu[above], zenith, turbidity)
    value[above] = sky * view.irradiance / (1000.0 * SOLAR_ILLUMINANCE / MAX_LUMINOUS_EFFICACY)
    return value, len(value)
