# SPDX-License-Identifier: GPL-3.0-or-later
"""Height fog: extinction that falls exponentially with height, or a slab of it, in a box fitted to scene and camera; a
local patch; or a fog by distance."""

import math

from .model import Group, Parameter
from .shared import ALBEDO, EXTINCTION, G, LOCATION, REALISATION, SIZE, having

EXPONENTIAL = ("profile", "exponential")  # what has an effect beside what
LAYERS = ("profile", "exponential", "slab")
PATCH = ("profile", "patch")
DEPTH_FOGS = ("linear", "exp", "exp2")
DEPTH_FOG = ("profile", *DEPTH_FOGS)
COMPOSITOR = ("realisation", "compositor", "automatic")
FAR = 1e6  # distances from here on count as infinite
CONTRAST = 0.02  # that a black object keeps at the distance of the visibility: Koschmieder 1924
CONTRAST_DEPTH = -math.log(CONTRAST)

FOG = Group(
    "fog", "Height fog", "Fog that thins with height, fills a slab or a patch, or hides by distance.",
    (
        having(EXTINCTION, 0.03, soft_maximum=1.0,
               description="Extinction coefficient sigma_t at the base height."),
        Parameter("visibility", "float", 0.0, f"Distance over which {CONTRAST:.0%} of the contrast is left at the base: extinction = "
                  f"{CONTRAST_DEPTH:.3f} / visibility. Where it is above 0 it counts instead of the extinction.",
                  unit="m", minimum=0.0, maximum=1e7, soft_maximum=2e4, live=True),
        Parameter("profile", "choice", "exponential", "Extinction that falls exponentially with height, or is constant up to one; a local "
                  "patch; or a depth fog, which knows the distance alone.",
                  choices=(("exponential", "Exponential"), ("slab", "Slab"), ("patch", "Patch"), ("linear", "Depth, linear"),
                           ("exp", "Depth, exponential"), ("exp2", "Depth, squared exponential"))),
        REALISATION,
        Parameter("slab_height", "float", 10.0, "Height of the slab above the base.",
                  unit="m", minimum=1e-2, maximum=1e5, soft_maximum=1e3, when=("profile", "slab")),
        having(LOCATION, (0.0, 0.0, 1.5), description="Centre of the patch in world space.", when=PATCH),
        having(SIZE, (20.0, 14.0, 3.0), description="Full size of the patch along x, y and z.", when=PATCH),
        Parameter("edge", "float", 0.8, "Share of the patch over which its fog thins out; 1 is thickest in the middle alone.",
                  minimum=0.01, maximum=4.0, soft_maximum=1.0, live=True, when=PATCH, title="Soft edge"),
        Parameter("noise_strength", "float", 0.5, "How far noise carves wisps into the patch; 0 leaves it smooth.",
                  minimum=0.0, maximum=4.0, soft_maximum=1.0, live=True, when=PATCH),
        Parameter("noise_size", "float", 3.0, "Size of the largest wisps.",
                  unit="m", minimum=1e-4, maximum=1e6, soft_minimum=0.01, soft_maximum=100.0, live=True, when=PATCH),
        Parameter("wind", "vector", (0.0, 0.0, 0.0), "Speed at which the wisps drift through the patch.",
                  unit="m/s", minimum=-1e3, maximum=1e3, live=True, when=PATCH),
        Parameter("time", "float", 0.0, "Seconds that the wind has blown: keyframe it to let the fog drift.",
                  unit="s", minimum=-1e6, maximum=1e6, soft_minimum=0.0, soft_maximum=600.0, live=True, when=PATCH),
        Parameter("scale_height", "float", 4.0, "Height over which the extinction falls to 1/e.",
                  unit="m", minimum=1e-3, maximum=1e5, soft_minimum=0.1, soft_maximum=1e3, live=True, when=EXPONENTIAL),
        Parameter("second_extinction", "float", 0.0, "Extinction of a second layer at the base height, such as thin haze above ground "
                  "fog; 0 leaves it out.", unit="1/m", minimum=0.0, maximum=1e5, soft_maximum=1.0, when=EXPONENTIAL),
        Parameter("second_scale_height", "float", 30.0, "Height over which the second layer falls to 1/e.",
                  unit="m", minimum=1e-3, maximum=1e5, soft_minimum=0.1, soft_maximum=1e3, live=True,
                  when=("second_extinction",)),
        Parameter("base_height", "float", 0.0, "Height of the base, where the fog ends below.",
                  unit="m", minimum=-1e5, maximum=1e5, live=True, when=LAYERS, live_when=EXPONENTIAL),
        having(ALBEDO, (0.95, 0.96, 0.98)),
        having(G, 0.6),
        Parameter("far_color", "color", (0.6, 0.7, 0.8), "Colour that a depth fog fades to.",
                  minimum=0.0, maximum=1.0, live=True, when=DEPTH_FOG),
        Parameter("far_radiance", "float", 0.5, "Brightness of that colour.",
                  unit="W/(m2 sr)", minimum=0.0, maximum=1e6, soft_maximum=10.0, live=True, when=DEPTH_FOG),
        Parameter("start", "float", 0.0, "Distance from the camera at which the compositor's fog begins.",
                  unit="m", minimum=0.0, maximum=1e6, soft_maximum=1e3, live=True, when=COMPOSITOR, title="Start distance"),
        Parameter("end", "float", 100.0, "Distance from the camera at which a linear depth fog is full.",
                  unit="m", minimum=1e-2, maximum=FAR, soft_maximum=1e4, live=True, when=("profile", "linear"), title="End distance"),
        Parameter("cutoff_distance", "float", FAR, "What is farther from the camera has no fog of the compositor: a backdrop, a painted "
                  "sky.", unit="m", minimum=1e-2, maximum=FAR, live=True, when=COMPOSITOR),
        Parameter("max_opacity", "float", 1.0, "Share that the compositor's fog hides at most.",
                  minimum=0.0, maximum=1.0, live=True, when=COMPOSITOR),
        Parameter("sun_tint", "color", (1.0, 1.0, 1.0), "Tint of the sun's light in the compositor's fog.",
                  minimum=0.0, maximum=1.0, live=True, when=COMPOSITOR),
        Parameter("cutoff", "float", 0.002, "Share of the base extinction at which the domain ends above.",
                  minimum=1e-6, maximum=0.5, when=EXPONENTIAL),
        Parameter("margin", "float", 5.0, "How far the domain reaches beyond the scene and the camera.",
                  unit="m", minimum=0.0, maximum=1e5, soft_maximum=100.0, when=LAYERS),
    ),
)
