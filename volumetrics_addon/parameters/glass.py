# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass: Beer-Lambert absorption in a solid or hollow body or in a thin pane."""

from .model import Group, Parameter
from .shared import LOCATION, SIZE, having
from .swatches import SWATCHES

CUSTOM, NONE = "custom", "none"
COVER_PATTERNS = ("uniform", "dirt", "lead")

GLASS = Group(
    "glass", "Glass", "Translucent body coloured by absorption along the path (Beer-Lambert).",
    (
        having(LOCATION, (0.0, 0.0, 0.05)),
        having(SIZE, (0.1, 0.1, 0.1)),
        Parameter("shape", "choice", "sphere", "Shape of the glass; a thin pane lies across its smallest size.",
                  choices=(("sphere", "Sphere"), ("block", "Block"), ("shell", "Hollow sphere"), ("sheet", "Thin pane"))),
        Parameter("thickness", "float", 0.003, "Thickness of the wall of a hollow sphere, or of a pane drawn as a plane.",
                  unit="m", minimum=1e-6, maximum=1e5, soft_minimum=1e-3, soft_maximum=0.1, when=("shape", "shell", "sheet")),
        Parameter("rotation", "float", 0.0, "Rotation about the vertical axis.",
                  unit="deg", minimum=-360.0, maximum=360.0),
        Parameter("swatch", "choice", CUSTOM, "Absorption of a real material, or a colour at a distance of your own.",
                  choices=((CUSTOM, "Custom"), *((name, swatch.label) for name, swatch in SWATCHES.items()))),
        Parameter("color", "color", (0.1, 0.5, 0.25), "Transmittance after the given distance, without interfaces.",
                  minimum=1e-6, maximum=1.0, live=True, when=("swatch", CUSTOM)),
        Parameter("distance", "float", 0.1, "Path length inside the glass at which the light has that colour.",
                  unit="m", minimum=1e-6, maximum=1e6, soft_minimum=1e-3, soft_maximum=10.0, live=True, when=("swatch", CUSTOM)),
        Parameter("strength", "float", 1.0, "Concentration of what absorbs: a factor on the absorption.",
                  minimum=0.0, maximum=1e4, soft_maximum=5.0, live=True),
        Parameter("refraction", "bool", True, "Bend and reflect light at the surface; off leaves a tinted volume only."),
        Parameter("ior", "float", 1.5, "Index of refraction.", title="IOR", minimum=1.0, maximum=4.0, soft_maximum=2.5, live=True,
                  when=("refraction",)),
        Parameter("coverage_pattern", "choice", NONE, "What lies opaque on a thin pane; none leaves its nodes out.",
                  choices=((NONE, "Clean"), ("uniform", "Uniform"), ("dirt", "Dirt"), ("lead", "Leaded cells")),
                  when=("shape", "sheet")),
        Parameter("coverage", "float", 0.15, "Opaque share of the pane's area.", minimum=0.0, maximum=1.0, live=True,
                  when=("coverage_pattern", *COVER_PATTERNS)),
        Parameter("coverage_color", "color", (0.03, 0.03, 0.035), "Diffuse reflectance of what covers the pane.", minimum=0.0,
                  maximum=1.0, live=True, when=("coverage_pattern", *COVER_PATTERNS)),
        Parameter("coverage_size", "float", 0.05, "Size of a cell between leads, or of a speck of dirt.", unit="m", minimum=1e-5,
                  maximum=1e5, soft_minimum=1e-3, soft_maximum=1.0, when=("coverage_pattern", "dirt", "lead")),
        Parameter("coverage_softness", "float", 0.5, "How gradually dirt begins: 0 has hard edges.", minimum=0.0,
                  maximum=1.0, live=True, when=("coverage_pattern", "dirt")),
        Parameter("color_variation", "float", 0.5, "How far the hue of the glass turns from cell to cell: 1 takes all hues.",
                  minimum=0.0, maximum=1.0, live=True, when=("coverage_pattern", "lead")),
        Parameter("coverage_seed", "int", 0, "Another number, another pattern of the same kind.", minimum=0, maximum=10000,
                  when=("coverage_pattern", "dirt", "lead")),
    ),
)
