# SPDX-License-Identifier: GPL-3.0-or-later
"""Adding-doubling: a flat homogeneous box as a slab without end, all orders of scattering, no noise.

Each camera ray that meets the box sees the angular radiance of the slab (see ``physics.slab``) of the box's height, under
the ray's own angle, per colour channel and sun. The edges of the box are where it differs from a slab: light that leaves
or enters through the sides, and lines of sight cut short by them.
"""

from __future__ import annotations

import numpy as np

from ..physics.slab import slab_radiance
from ..scene import geometry
from ..scene.model import Box, Homogeneous, Scene, Sun
from . import optics
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = ("The box counts as a slab without end: in the middle of one ten times as wide as high this is up to 3 % too bright "
        "(twenty times: below 1 %), and within its height of the edges it is wrong altogether.")
SETTINGS: tuple[dict, ...] = tuple({"quadrature": points} for points in (4, 8, 16, 24, 48))

FLATNESS = 10.0  # smallest width over height
MANY_ORDERS = 64
LOWEST_SUN = 1e-3  # smallest |z| of a sun's direction


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    if scene.orders < MANY_ORDERS:
        return f"the scene stops at {scene.orders} orders of scattering, this integrator never (orders >= {MANY_ORDERS})"
    if scene.is_dielectric:
        return "the scene refracts"
    if len(scene.volumes) != 1:
        return f"the scene has {len(scene.volumes)} volumes, a slab is one"
    if scene.surfaces:
        return "the scene has surfaces"
    if max(scene.environment) > 0.0:
        return "an environment lights the slab"
    if not all(isinstance(light, Sun) for light in scene.lights):
        return "a light is not a sun"
    if any(abs(light.direction[2]) < LOWEST_SUN for light in scene.lights):
        return "a sun stands at the horizon"
    volume = scene.volumes[0]
    box = volume.domain
    if not isinstance(box, Box) or abs(box.axes[2][2]) < 1.0 - 1e-9:
        return "the volume is not a level box"
    if volume.medium.glows:
        return "the medium has ambient light"
    if not isinstance(volume.medium.density, Homogeneous):
        return "the density varies"
    if not 0.0 < FLATNESS * box.half[2] <= min(box.half[:2]):
        return f"the box is not flat: its width must be at least {FLATNESS:g} times its height"
    if abs(scene.camera.position[2] - box.center[2]) <= box.half[2]:
        return "the camera is neither above nor below the slab"
    return ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 1, strata: int = 0, seed: int = 0,
           progress: Progress | None = None, quadrature: int = 24) -> Result:
    """Image of the scene with all orders of scattering; ``quadrature`` is the number of directions per hemisphere.

    ``strata`` 0: one ray through the centre of each pixel, the same in every run; the error is that of the quadrature,
    per pixel. Otherwise each of ``repeats`` equally distributed images averages strata^2 jittered rays per pixel, and their
    spread adds to the error. Raises ValueError when the
    integrator does not apply (see ``applies``).
    """
    if reason := applies(scene):
        raise ValueError(f"adding_doubling does not apply: {reason}; use path_tracing")
    return render_rays("adding_doubling", lambda origin, direction, rng: radiance(scene, origin, direction, quadrature), scene,
                       width, height, repeats=repeats, strata=strata, seed=seed, random=False, progress=progress)


def radiance(scene: Scene, origin: Array, direction: Array, quadrature: int = 24) -> tuple[Array, Array, int]:
    """Radiance (n, 3) along rays (n, 3), its quadrature error, and the number of evaluations of the slab."""
    volume = scene.volumes[0]
    medium, box = volume.medium, volume.domain
    near, far = geometry.interval(box, origin, direction)
    rows = np.flatnonzero((near < far) & (far > 0.0))
    value, error = np.zeros((2, len(direction), 3))
    travel = -direction[rows]
    sigma_t = np.array(medium.sigma_t)
    albedo = np.array(medium.sigma_s) / np.where(sigma_t > 0.0, sigma_t, 1.0)
    slabs = np.stack([np.minimum(albedo, 1.0), 2.0 * box.half[2] * sigma_t])
    slabs, channels = np.unique(slabs, axis=1, return_inverse=True)
    evaluations = 0
    for light in scene.lights:
        sun = np.array(light.direction)
        azimuth = np.arctan2(sun[0] * travel[:, 1] - sun[1] * travel[:, 0], travel[:, :2] @ sun[:2])
        # A sun below the slab is one above it in a mirror.
        mu = -np.sign(sun[2]) * travel[:, 2]
        for i, (slab_albedo, tau) in enumerate(slabs.T):
            seen = slab_radiance(lambda c: optics.phase_value(medium.phase, c), slab_albedo, tau, abs(sun[2]), mu, azimuth,
                                 quadrature=quadrature)
            evaluations += len(rows)
            for channel in np.flatnonzero(channels.ravel() == i):
                value[rows, channel] += light.irradiance[channel] * seen.value
                error[rows, channel] += light.irradiance[channel] * seen.error_estimate
    return value, error, evaluations
