# SPDX-License-Identifier: GPL-3.0-or-later
"""Sky by quadrature of single scattering, with the exact depth of the air towards sun and camera at every node.

L = integral of sigma_s rho p(cos) E T(sun, x) T(x, camera) dt over the parts of the view ray in sunlight, which are
found, not sampled, and the ground, lit by the attenuated sun. Nodes lie dense where the ray is lowest
(physics.atmosphere.ray_nodes). Source: Nishita et al., Display of the Earth taking into account atmospheric scattering,
SIGGRAPH 1993.
"""

from __future__ import annotations

import time

import numpy as np

from ..scene.model import Scene
from . import planet
from .result import Progress, Result
from .sky_tables import missing_orders

Array = np.ndarray

BIAS = ("Light scattered more than once is missing, 33 % of a clear sky's mean at noon and 19 % at sunset; exact for scenes of "
        "one order.")
SETTINGS = ({"order": 4}, {"order": 6}, {"order": 8}, {"order": 12}, {"order": 16}, {"order": 32})


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    view = planet.planet_of(scene)
    return view if isinstance(view, str) else ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 1, strata: int = 0, seed: int = 0, order: int = 16,
           progress: Progress | None = None) -> Result:
    """Image of the sky in single scattering, ``order`` >= 3 Gauss nodes on each lit part of a ray.

    The error estimate of a pixel is the difference to three quarters as many nodes, and for scenes of more orders an
    estimate of what they would add. Raises ValueError when the integrator does not apply.
    """
    if order < 3:
        raise ValueError(f"order must be >= 3, got {order}; 16 is usual")
    started = time.perf_counter()
    view = planet.required_view(scene, "sky_single_scattering")
    missing = missing_orders(view, scene, width, height, 1)
    return planet.image(scene, width, height, "sky_single_scattering", lambda o, d: radiance(view, o, d, order),
                        lambda o, d: radiance(view, o, d, 3 * order // 4), repeats=repeats, strata=strata, seed=seed,
                        progress=progress, missing=missing, started=started)


def radiance(view: planet.View, origin: Array, direction: Array, order: int) -> tuple[Array, int]:
    """Radiance (n, 3) of one order of scattering along rays (n, 3), and the number of nodes."""
    rays = view.rays(origin, direction)
    body = view.planet
    value = view.reflected(rays, view.direct)
    index, t, weight = rays.samples(body, order, lit=True)
    radius, _, mu_s = rays.at(index, t)
    radius = np.clip(radius, body.radius, body.top)
    # Nodes lie in the light: rounding at the shadow's edge must not put one out.
    light = body.sunlight(radius, np.maximum(mu_s, body.horizon(radius)))
    light *= body.transmittance(rays.radius[index, None], rays.mu[index, None], t)
    strength = weight[..., None] * body.density(radius) * body.phases(rays.nu)[index, None, :]
    scattered = np.einsum("nkx,nkc,cx->nx", light, strength, body.scattering, optimize=True) * view.irradiance
    for channel in range(3):
        value[:, channel] += np.bincount(index, scattered[:, channel], len(value))
    return value, t.size
