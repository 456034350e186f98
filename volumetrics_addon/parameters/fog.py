# SPDX-License-Identifier: GPL-3.0-or-later
"""Height fog: extinction that falls exponentially with height, or a slab of it, in a box fitted to scene and camera."""

import math

from .model import Group, Parameter
from .shared import ALBEDO, EXTINCTION, G, having

EXPONENTIAL = ("profile", "exponential")  # what has an effect beside what
CONTRAST = 0.02  # that a black object keeps at the distance of the visibility: Koschmieder 1924
CONTRAST_DEPTH = -math.log(CONTRAST)

FOG = Group(
    "fog", "Height fog", "Fog whose extinction falls exponentially with height above its base, or fills a slab.",
    (
        having(EXTINCTION, 0.03, soft_maximum=1.0,
               description="Extinction coefficient sigma_t at the base height."),
        Parameter("visibility", "float", 0.0, f"Distance over which {CONTRAST:.0%} of the contrast is left at the base: extinction = "
                  f"{CONTRAST_DEPTH:.3f} / visibility. Where it is above 0 it counts instead of the extinction.",
                  unit="m", minimum=0.0, maximum=1e7, soft_maximum=2e4, live=True),
        Parameter("profile", "choice", "exponential", "How the extinction goes with height: falling exponentially, or constant up to "
                  "a height.", choices=(("exponential", "Exponential"), ("slab", "Slab"))),
        Parameter("slab_height", "float", 10.0, "Height of the slab above the base.",
                  unit="m", minimum=1e-2, maximum=1e5, soft_maximum=1e3, when=("profile", "slab")),
        Parameter("scale_height", "float", 4.0, "Height over which the extinction falls to 1/e.",
                  unit="m", minimum=1e-3, maximum=1e5, soft_minimum=0.1, soft_maximum=1e3, live=True, when=EXPONENTIAL),
        Parameter("second_extinction", "float", 0.0, "Extinction of a second layer at the base height, such as thin haze above ground "
                  "fog; 0 leaves it out.", unit="1/m", minimum=0.0, maximum=1e5, soft_maximum=1.0, when=EXPONENTIAL),
        Parameter("second_scale_height", "float", 30.0, "Height over which the second layer falls to 1/e.",
                  unit="m", minimum=1e-3, maximum=1e5, soft_minimum=0.1, soft_maximum=1e3, live=True,
                  when=("second_extinction",)),
        Parameter("base_height", "float", 0.0, "Height of the base, where the fog ends below.",
                  unit="m", minimum=-1e5, maximum=1e5, live=True, live_when=EXPONENTIAL),
        having(ALBEDO, (0.95, 0.96, 0.98)),
        having(G, 0.6),
        Parameter("cutoff", "float", 0.002, "Share of the base extinction at which the domain ends above.",
                  minimum=1e-6, maximum=0.5, when=EXPONENTIAL),
        Parameter("margin", "float", 5.0, "How far the domain reaches beyond the scene and the camera.",
                  unit="m", minimum=0.0, maximum=1e5, soft_maximum=100.0),
    ),
)
