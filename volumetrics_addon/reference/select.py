# SPDX-License-Identifier: GPL-3.0-or-later
"""The integrator that renders a scene with the least error."""

from __future__ import annotations

from types import ModuleType

from ..scene.model import Scene
from . import dielectric, path_tracing, single_scattering

# Exact methods first; the path tracer renders nearly everything.
INTEGRATORS: tuple[ModuleType, ...] = (single_scattering, dielectric, path_tracing)


def integrator(scene: Scene) -> ModuleType:
    """The first integrator that applies. Raises ValueError with every integrator's reason when none does."""
    reasons = []
    for module in INTEGRATORS:
        reason = module.applies(scene)
        if not reason:
            return module
        reasons.append(f"{module.__name__.rsplit('.', 1)[-1]}: {reason}")
    raise ValueError("no reference integrator can render this scene; " + "; ".join(reasons))
