# SPDX-License-Identifier: GPL-3.0-or-later
"""Height fog: extinction that falls exponentially with height, in a box fitted to scene and camera."""

from .model import Group, Parameter
from .shared import ALBEDO, EXTINCTION, G, having

FOG = Group(
    "fog", "Height fog", "Fog whose extinction falls exponentially with height above its base.",
    (
        having(EXTINCTION, 0.03, soft_maximum=1.0,
               description="Extinction coefficient sigma_t at the base height."),
        Parameter("scale_height", "float", 4.0, "Height over which the extinction falls to 1/e.",
                  unit="m", minimum=1e-3, maximum=1e5, soft_minimum=0.1, soft_maximum=1e3, live=True),
        Parameter("base_height", "float", 0.0, "Height of the base, where the fog ends below.",
                  unit="m", minimum=-1e5, maximum=1e5, live=True),
        having(ALBEDO, (0.95, 0.96, 0.98)),
        having(G, 0.6),
        Parameter("cutoff", "float", 0.002, "Share of the base extinction at which the domain ends above.",
                  minimum=1e-6, maximum=0.5),
        Parameter("margin", "float", 5.0, "How far the domain reaches beyond the scene and the camera.",
                  unit="m", minimum=0.0, maximum=1e5, soft_maximum=100.0),
    ),
)
