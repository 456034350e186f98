# SPDX-License-Identifier: GPL-3.0-or-later
"""The integrators: all of them by name, and the one that renders a scene with the least error.

An integrator is a module with

* ``applies(scene) -> str``: empty, or the reason why it cannot render the scene;
* ``render(scene, width, height, *, repeats, strata, seed, progress, ...) -> Result``: ``strata`` 0 is one ray through
  each pixel's centre, other keywords are its own settings;
* ``SETTINGS``: its own settings from quick to accurate; ``BIAS``: its error by construction, in a sentence;
* a docstring whose first line says what it does.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from ..scene.model import Scene

# Exact methods first: the first that applies is the reference; the path tracer renders nearly everything.
REFERENCES = ("single_scattering", "dielectric", "sky_tables", "path_tracing")
RIVALS = (
    "ray_marching", "quarter_resolution", "light_slices", "half_angle_slices", "froxels", "octaves", "adding_doubling",
    "ambient_scattering", "ambient_occlusion", "emission_absorption", "sky_single_scattering",
    "aerial_perspective", "preetham_sky", "depth_fog", "depth_air",
)
NAMES = REFERENCES + RIVALS


def load(name: str) -> ModuleType:
    """The integrator of that name. Raises ValueError for an unknown one, with the names there are."""
    if name not in NAMES:
        raise ValueError(f"there is no integrator {name!r}; the integrators are {', '.join(NAMES)}")
    return import_module(f".{name}", __package__)


def summary(module: ModuleType) -> str:
    """First line of the module's docstring."""
    return module.__doc__.strip().splitlines()[0]


def integrator(scene: Scene) -> ModuleType:
    """The first reference that applies, or the formula of a fog that no medium makes.

    Raises ValueError with every integrator's reason when none does.
    """
    if not scene.has_light_transport:
        return load("depth_fog")
    reasons = []
    for name in REFERENCES:
        module = load(name)
        reason = module.applies(scene)
        if not reason:
            return module
        reasons.append(f"{name}: {reason}")
    raise ValueError("no reference integrator can render this scene; " + "; ".join(reasons))
