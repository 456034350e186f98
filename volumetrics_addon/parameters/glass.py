# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass: Beer-Lambert colour at a distance, in a solid block or sphere."""

from .model import Group, Parameter
from .shared import LOCATION, SIZE, having

GLASS = Group(
    "glass", "Glass", "Translucent solid coloured by absorption along the path (Beer-Lambert).",
    (
        having(LOCATION, (0.0, 0.0, 0.05)),
        having(SIZE, (0.1, 0.1, 0.1)),
        Parameter("shape", "choice", "sphere", "Shape of the solid.", choices=(("sphere", "Sphere"), ("block", "Block"))),
        Parameter("rotation", "float", 0.0, "Rotation of the solid about the vertical axis.",
                  unit="deg", minimum=-360.0, maximum=360.0),
        Parameter("color", "color", (0.1, 0.5, 0.25), "Transmittance after the given distance, without interfaces.",
                  minimum=1e-6, maximum=1.0, live=True),
        Parameter("distance", "float", 0.1, "Path length inside the glass at which the light has that colour.",
                  unit="m", minimum=1e-6, maximum=1e6, soft_minimum=1e-3, soft_maximum=10.0, live=True),
        Parameter("refraction", "bool", True, "Bend and reflect light at the surface; off leaves a tinted volume only."),
        Parameter("ior", "float", 1.5, "Index of refraction.", title="IOR", minimum=1.0, maximum=4.0, soft_maximum=2.5, live=True),
    ),
)
