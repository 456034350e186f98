# SPDX-License-Identifier: GPL-3.0-or-later
"""Godray: a spot light in haze, with blockers that cut its beam into streaks."""

from .model import Group, Parameter
from .shared import ALBEDO, EXTINCTION, G, LOCATION, having

GODRAY = Group(
    "godray", "Godray", "Spot light in haze with blockers that cut streaks.",
    (
        having(LOCATION, (0.0, 0.0, 6.0), description="Position of the light in world space."),
        Parameter("target", "vector", (0.0, 0.0, 0.0), "Point the light looks at.", unit="m", minimum=-1e6, maximum=1e6),
        Parameter("power", "float", 2000.0, "Power of the light as Blender counts it: intensity power / (4 pi).",
                  unit="W", minimum=0.0, maximum=1e9, soft_maximum=1e5),
        Parameter("color", "color", (1.0, 1.0, 1.0), "Colour of the light.", minimum=0.0, maximum=1.0),
        Parameter("cone_angle", "float", 40.0, "Full angle of the light's cone.", unit="deg", minimum=1.0, maximum=160.0),
        Parameter("blend", "float", 0.2, "Soft part of the cone's edge.", minimum=0.0, maximum=1.0),
        Parameter("length", "float", 8.0, "How far the haze reaches along the beam.",
                  unit="m", minimum=1e-2, maximum=1e5, soft_maximum=1e3),
        Parameter("domain", "choice", "cone", "Shape of the haze: only the beam, or a box around it.",
                  choices=(("cone", "Cone"), ("box", "Box"))),
        having(EXTINCTION, 0.05, soft_maximum=1.0),
        having(ALBEDO, (0.9, 0.9, 0.9)),
        having(G, 0.5),
        Parameter("blocker", "choice", "slats", "What stands in the beam.",
                  choices=(("none", "Nothing"), ("slats", "Slats"), ("window", "Window bars"))),
        Parameter("blocker_count", "int", 5, "Number of bars across the beam (each way, for a window).",
                  minimum=1, maximum=64),
        Parameter("blocker_fill", "float", 0.5, "Share of the beam that the bars cover across their direction.",
                  minimum=0.01, maximum=0.99),
        Parameter("blocker_distance", "float", 1.0, "Distance of the bars from the light.",
                  unit="m", minimum=1e-3, maximum=1e5, soft_maximum=100.0),
        Parameter("blocker_rotation", "float", 0.0, "Rotation of the bars about the beam.",
                  unit="deg", minimum=-360.0, maximum=360.0),
    ),
)
