# SPDX-License-Identifier: GPL-3.0-or-later
"""View-aligned slices through the frustum of each spot and projector light, summed per pixel.

The frustum of a light is the hexahedron of the eight corners of its near and far face; the near face may shrink to the
light itself. The box of these corners along the camera's axes, cut by that of the media, is filled with ``slices``
planes perpendicular to the view axis, placed by interpolation between its nearest and farthest depth. Every pixel sums
the planes between the ray's entry into the light's cone or frustum and its exit, each with the light that it scatters
there and the length of the ray between its neighbours' midplanes: slices are spent on the beam alone, and the first and
last one in part (Dobashi, Yamamoto and Nishita, Interactive rendering of atmospheric scattering effects using graphics
hardware, Graphics Hardware 2002; Mitchell, Light shafts: rendering shadows in participating media, GDC 2004).

Optical depths are those of the closed form, or of ``light_steps`` midpoints where a density has none.
"""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np

from ..physics import projector
from ..scene import geometry
from ..scene.model import Projector, Scene, Spot, look_frame
from . import marching, optics
from .result import Progress, Result

Array = np.ndarray

BIAS = ("Error of the slices: second order where light is smooth, first order at hard cones and shadows. "
        + marching.SINGLE_BIAS)
SETTINGS = tuple({"slices": slices} for slices in (4, 8, 16, 32, 64, 128, 256))

WIDEST = np.radians(80.0)  # half angle beyond which a frustum fills its media


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    if reason := marching.applies(scene):
        return reason
    for light in scene.lights:
        if not isinstance(light, (Spot, Projector)):
            return f"a {type(light).__name__} light has no frustum to slice"
    return marching.glowing(scene)


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, slices: int = 32,
           light_steps: int = marching.LIGHT_STEPS, seed: int = 0, progress: Progress | None = None) -> Result:
    """Image of the scene in single scattering, with ``slices`` planes through each light's frustum.

    ``repeats``, ``strata`` and ``light_steps`` are those of ray_marching. Raises ValueError when the integrator does not
    apply (see ``applies``) and for fewer than one slice.
    """
    marching.refuse("light_slices", applies(scene))
    marching.counted("slices", slices, "use 16 for a preview, 128 for a reference")
    marching.counted("light_steps", light_steps, "use 8 for a preview, 64 for a reference")

    def gather(origin: Array, direction: Array, hit: Array) -> tuple[Array, Array, int]:
        lights = scene.lights if scene.volumes else ()
        return marching.summed((_beam(scene, light, slices, origin, direction, hit, light_steps) for light in lights), len(hit))

    return marching.render_gathered("light_slices", gather, scene, width, height, slices, light_steps, repeats=repeats,
                                    strata=strata, seed=seed, progress=progress)


def frustum_corners(light: Spot | Projector, reach: float) -> Array:
    """Corners (8, 3) of the hexahedron around the light's cone or frustum up to the distance ``reach`` along its axis."""
    if isinstance(light, Spot):
        forward = np.array(light.direction)
        right, up, _ = (np.array(axis) for axis in look_frame(light.direction))
        near, far, slope = 0.0, reach, np.full(2, np.tan(light.cone_angle / 2.0))
    else:
        forward = np.array(light.direction)
        right = np.cross(forward, np.array(light.up))
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        near, far = light.near, max(light.near, min(light.far, reach))
        slope = np.tan(np.array((light.horizontal_fov, light.vertical_fov)) / 2.0)
    return np.array([np.array(light.position) + z * (forward + x * slope[0] * right + y * slope[1] * up)
                     for z, y, x in product((near, far), (-1, 1), (-1, 1))])


def _depths(scene: Scene, light: Spot | Projector) -> tuple[float, float]:
    """Nearest and farthest depth along the view axis of what the light can reach of the media."""
    forward = geometry.view_axes(scene.camera)[2]
    media = marching.media_corners(scene)
    ends = np.array(scene.camera.position) @ forward
    low, high = (f(media @ forward) - ends for f in (np.min, np.max))
    half_angle = (light.cone_angle if isinstance(light, Spot) else max(light.horizontal_fov, light.vertical_fov)) / 2.0
    if half_angle < WIDEST:
        reach = max(0.0, ((media - np.array(light.position)) @ np.array(light.direction)).max())
        box = frustum_corners(light, reach) @ forward - ends
        low, high = max(low, box.min()), min(high, box.max())
    return max(low, 0.0), max(high, 0.0)


def _lit_interval(light: Spot | Projector, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Where the rays (n, 3) are within the light's cone or frustum."""
    if isinstance(light, Spot):
        cosine = np.cos(light.cone_angle / 2.0)
        return geometry.nappe_interval(origin - np.array(light.position), direction, np.array(light.direction), cosine**2)
    found = projector.projector_interval(origin, direction, light_direction=light.direction, **optics.frustum_of(light))
    return found.entry, found.exit


def _beam(scene: Scene, light: Spot | Projector, slices: int, origin: Array, direction: Array, hit: Array,
          light_steps: int) -> tuple[Array, Array, int]:
    """Light (n, 3) scattered from one frustum into the rays, its doubt (n, 3) and the number of samples."""
    near, far = marching.media_interval(scene, origin, direction, hit)
    entry, leave = _lit_interval(light, origin, direction)
    forward = geometry.view_axes(scene.camera)[2]
    planes = np.linspace(*_depths(scene, light), slices + 1) + np.array(scene.camera.position) @ forward
    cut = marching.slabs(origin, direction, np.maximum(entry, near), np.minimum(leave, far), forward, planes)
    d = direction[cut.ray]
    position = origin[cut.ray] + cut.middle[:, None] * d
    within = marching.extinction(scene, position) * cut.length[:, None]

    def contributions(steps: int) -> Array:
        depth = partial(marching.optical_depth, scene, steps=steps)
        # The depth to the middle is known; the step begins half its own depth before.
        before = np.maximum(depth(origin[cut.ray], d, cut.middle) - within / 2.0, 0.0)
        value = np.zeros((len(direction), slices, 3))
        value[cut.ray, cut.slab] = (marching.scattered_toward(scene, light, position, d, depth) * np.exp(-before)
                                    * marching.mean_transmittance(within) * cut.length[:, None])
        return value

    value = contributions(light_steps)
    length = np.zeros((len(direction), slices))
    length[cut.ray, cut.slab] = cut.length
    doubt = marching.nested_doubt(value, length)
    if scene.is_noisy:
        doubt += np.abs(value - contributions(marching.fewer(light_steps))).sum(axis=1)
    return value.sum(axis=1), doubt, len(cut.ray)
