# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters that mean the same in several families, declared here once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .model import Parameter

LOCATION = Parameter(
    "location", "vector", (0.0, 0.0, 0.0), "Centre of the domain in world space.",
    unit="m", minimum=-1e6, maximum=1e6,
)
SIZE = Parameter(
    "size", "vector", (2.0, 2.0, 2.0), "Full size of the domain along x, y and z.",
    unit="m", minimum=1e-3, maximum=1e6, soft_minimum=0.01, soft_maximum=1e4,
)
EXTINCTION = Parameter(
    "extinction", "float", 0.05, "Extinction coefficient sigma_t where the density is 1: the fraction of light "
    "lost per metre, for short distances.",
    unit="1/m", minimum=0.0, maximum=1e5, soft_maximum=10.0, live=True,
)
ALBEDO = Parameter(
    "albedo", "color", (0.99, 0.99, 0.99), "Single-scattering albedo sigma_s / sigma_t: what is scattered on "
    "rather than absorbed.",
    minimum=0.0, maximum=1.0, live=True,
)
G = Parameter(
    "g", "float", 0.7, "Mean cosine of the Henyey-Greenstein phase function: above 0 forward, below 0 backward. "
    "Both engines clamp it to 0.999.",
    minimum=-0.999, maximum=0.999, live=True, title="Anisotropy g",
)
REALISATION = Parameter(
    "realisation", "choice", "automatic", "A volume, or a pass of the compositor from the depth of each pixel: no noise, no shafts. "
    "Automatic: the compositor where it loses less.",
    choices=(("automatic", "Automatic"), ("volume", "Volume"), ("compositor", "Compositor")),
)


def having(parameter: Parameter, default: Any, **changes: Any) -> Parameter:
    """A shared parameter with another default for one family."""
    return replace(parameter, default=default, **changes)
