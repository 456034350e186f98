# SPDX-License-Identifier: GPL-3.0-or-later
"""Godray: a lamp or a projector in haze, or the sun through an opening, with blockers that cut the beam into streaks."""

from .model import Group, Parameter
from .shared import ALBEDO, EXTINCTION, G, LOCATION, having

PROJECTOR = ("light", "projector")
LAMP = ("light", "spot", "projector")
SUN = ("light", "sun")
PATTERN = ("gobo", "window", "blinds", "leaves", "water", "stained_glass")
DUST = ("dust_strength",)
GOBO = (*PATTERN, "image")

GODRAY = Group(
    "godray", "Godray", "Spot light, projector or sunlight in haze with blockers that cut streaks.",
    (
        Parameter("light", "choice", "spot", "A round spot, a projector with a picture in its light, or the sun through openings.",
                  choices=(("spot", "Spot"), ("projector", "Projector"), ("sun", "Sun"))),
        having(LOCATION, (0.0, 0.0, 6.0), description="Position of the light in world space, or middle of the opening."),
        Parameter("target", "vector", (0.0, 0.0, 0.0), "Point the light looks at; sunlight goes from the opening to there.",
                  unit="m", minimum=-1e6, maximum=1e6),
        Parameter("power", "float", 2000.0, "Power of the light as Blender counts it: intensity power / (4 pi).",
                  unit="W", minimum=0.0, maximum=1e9, soft_maximum=1e5, when=LAMP),
        Parameter("irradiance", "float", 3.0, "Irradiance of the sun on a surface that faces it; 0 adds no sun, that of the scene "
                  "lights the shafts.", unit="W/m2", minimum=0.0, maximum=1e6, soft_maximum=100.0, when=SUN),
        Parameter("opening_width", "float", 1.0, "Width of the opening.", unit="m", minimum=1e-3, maximum=1e4, soft_maximum=20.0,
                  when=SUN),
        Parameter("opening_height", "float", 2.0, "Height of the opening.", unit="m", minimum=1e-3, maximum=1e4, soft_maximum=20.0,
                  when=SUN),
        Parameter("opening_azimuth", "float", 0.0, "Direction in which the opening faces, from +y (north) towards +x (east).",
                  unit="deg", minimum=-360.0, maximum=360.0, when=SUN),
        Parameter("opening_tilt", "float", 90.0, "How far the opening leans back: 0 in a wall, 90 in a level roof.", unit="deg",
                  minimum=-90.0, maximum=90.0, when=SUN),
        Parameter("shaft_end", "choice", "floor", "Where the haze behind an opening ends: on the floor, or after its length.",
                  choices=(("floor", "Floor"), ("length", "Length")), when=SUN),
        Parameter("floor_height", "float", 0.0, "Height of the floor on which the light falls.", unit="m", minimum=-1e6, maximum=1e6,
                  soft_minimum=-100.0, soft_maximum=100.0, when=("shaft_end", "floor")),
        Parameter("color", "color", (1.0, 1.0, 1.0), "Colour of the light.", minimum=0.0, maximum=1.0),
        Parameter("cone_angle", "float", 40.0, "Full angle of the light's cone.", unit="deg", minimum=1.0, maximum=160.0,
                  when=("light", "spot")),
        Parameter("blend", "float", 0.2, "Soft part of the edge of the cone or frustum.", minimum=0.0, maximum=1.0, when=LAMP),
        Parameter("frustum", "choice", "rectangular", "Outline of the projector's beam; elliptic with equal angles is round.",
                  choices=(("rectangular", "Rectangular"), ("elliptic", "Elliptic")), when=PROJECTOR),
        Parameter("horizontal_fov", "float", 30.0, "Full angle of the beam from side to side.", unit="deg", minimum=0.1,
                  maximum=150.0, when=PROJECTOR, title="Horizontal angle"),
        Parameter("vertical_fov", "float", 30.0, "Full angle of the beam from top to bottom.", unit="deg", minimum=0.1,
                  maximum=150.0, when=PROJECTOR, title="Vertical angle"),
        Parameter("roll", "float", 0.0, "Rotation of the projector about its beam.", unit="deg", minimum=-360.0, maximum=360.0,
                  when=PROJECTOR),
        Parameter("near", "float", 0.0, "Where the light and its haze begin, along the beam.", unit="m", minimum=0.0, maximum=1e5,
                  soft_maximum=100.0, when=PROJECTOR),
        Parameter("far", "float", 1e6, "Where the light ends, along the beam. EEVEE knows the end of the haze alone.", unit="m",
                  minimum=1e-2, maximum=1e6, when=PROJECTOR),
        Parameter("falloff", "choice", "quadratic", "How the light falls with the distance; all are equal at one metre. EEVEE knows "
                  "the quadratic one alone.", choices=(("quadratic", "Quadratic"), ("linear", "Linear"), ("constant", "Constant")),
                  when=PROJECTOR),
        Parameter("count", "int", 1, "Lights or openings side by side; several lamps share a box of haze.", minimum=1, maximum=8),
        Parameter("spacing", "float", 1.4, "Distance from one to the next.", unit="m", minimum=1e-3, maximum=1e4, soft_maximum=20.0),
        Parameter("length", "float", 8.0, "How far the haze reaches along the beam.",
                  unit="m", minimum=1e-2, maximum=1e5, soft_maximum=1e3),
        Parameter("domain", "choice", "cone", "Shape of the haze: only the beam, or a box around it.",
                  choices=(("cone", "Beam"), ("box", "Box")), when=LAMP),
        having(EXTINCTION, 0.05, soft_maximum=1.0),
        having(ALBEDO, (0.9, 0.9, 0.9)),
        having(G, 0.5),
        Parameter("ambient", "float", 0.0, "Radiance that reaches all of the haze from all sides, unshadowed and undimmed, and is "
                  "scattered once.", unit="W/(m2 sr)", minimum=0.0, maximum=1e6, soft_maximum=10.0, live=True),
        Parameter("ambient_color", "color", (1.0, 1.0, 1.0), "Colour of the ambient light.", minimum=0.0, maximum=1.0, live=True),
        Parameter("dust_strength", "float", 0.0, "Unevenness of the haze, whose density is 1 + strength times noise between -1 and 1; 0 "
                  "leaves its nodes out.", minimum=0.0, maximum=10.0, soft_maximum=2.0),
        Parameter("dust_size", "float", 1.0, "Size of the largest swathes.", unit="m", minimum=1e-3, maximum=1e5, soft_minimum=0.05,
                  soft_maximum=20.0, live=True, when=DUST),
        Parameter("dust_drift", "vector", (0.0, 0.0, 0.0), "Velocity at which the swathes drift.", unit="m/s", minimum=-1e3, maximum=1e3,
                  soft_minimum=-2.0, soft_maximum=2.0, live=True, when=DUST),
        Parameter("dust_time", "float", 0.0, "Moment at which the drifting swathes are shown.", unit="s", minimum=-1e6, maximum=1e6,
                  soft_minimum=-100.0, soft_maximum=100.0, live=True, when=DUST),
        Parameter("dust_seed", "int", 0, "Another number makes other swathes.", minimum=0, maximum=9999, when=DUST),
        Parameter("gobo", "choice", "none", "Picture in the projector's light.",
                  choices=(("none", "None"), ("window", "Window"), ("blinds", "Blinds"), ("leaves", "Leaves"), ("water", "Water"),
                           ("stained_glass", "Stained glass"), ("image", "Image file")), when=PROJECTOR),
        Parameter("gobo_image", "path", "", "Picture file, which fills the frustum at scale 1 and repeats; what is transparent in it "
                  "lets the light through.", maximum=1000, when=("gobo", "image"), title="Image file"),
        Parameter("gobo_count", "int", 4, "Panes, slats, leaves or ripples across the height of the picture.", minimum=1,
                  maximum=64, when=PATTERN),
        Parameter("gobo_softness", "float", 0.1, "Share of a pane, slat or leaf over which its edges fade.", minimum=0.0,
                  maximum=1.0, live=True, when=PATTERN),
        Parameter("gobo_scale", "float", 1.0, "Size of the pattern.", minimum=0.01, maximum=100.0, soft_maximum=10.0, live=True,
                  when=GOBO),
        Parameter("gobo_rotation", "float", 0.0, "Rotation of the pattern in the beam.", unit="deg", minimum=-360.0,
                  maximum=360.0, live=True, when=GOBO),
        Parameter("gobo_drift_right", "float", 0.0, "Speed of the pattern to the right, in half heights of the picture.",
                  unit="1/s", minimum=-100.0, maximum=100.0, live=True, when=GOBO),
        Parameter("gobo_drift_up", "float", 0.0, "Speed of the pattern upwards, in half heights of the picture.",
                  unit="1/s", minimum=-100.0, maximum=100.0, live=True, when=GOBO),
        Parameter("gobo_time", "float", 0.0, "Moment at which the drifting pattern is shown.", unit="s", minimum=-1e6, maximum=1e6,
                  live=True, when=GOBO),
        Parameter("gobo_seed", "int", 0, "Another number makes another picture of leaves, water or glass.", minimum=0,
                  maximum=9999, when=PATTERN),
        Parameter("gobo_resolution", "int", 64, "Pixels along the longer side of the picture that stands for a pattern on a stage, or "
                  "for a file.", minimum=2, maximum=512, when=GOBO),
        Parameter("blocker", "choice", "slats", "What stands in the beam.",
                  choices=(("none", "Nothing"), ("slats", "Slats"), ("window", "Window bars"))),
        Parameter("blocker_count", "int", 5, "Number of bars across the beam or opening (each way, for a window).",
                  minimum=1, maximum=64),
        Parameter("blocker_fill", "float", 0.5, "Share of the beam that the bars cover across their direction.",
                  minimum=0.01, maximum=0.99),
        Parameter("blocker_distance", "float", 1.0, "Distance of the bars from a lamp; in an opening they stand in its plane.",
                  unit="m", minimum=1e-3, maximum=1e5, soft_maximum=100.0, when=LAMP),
        Parameter("blocker_rotation", "float", 0.0, "Rotation of the bars about the beam.",
                  unit="deg", minimum=-360.0, maximum=360.0),
    ),
)
