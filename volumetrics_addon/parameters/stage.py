# SPDX-License-Identifier: GPL-3.0-or-later
"""The stage on which a preset is rendered and verified: camera, sun, environment, props."""

from .model import Group, Parameter

STAGE = Group(
    "stage", "Stage", "Camera, sun and environment of the preset's own picture.",
    (
        Parameter("camera_location", "vector", (0.0, -10.0, 2.0), "Position of the camera.", unit="m",
                  minimum=-1e6, maximum=1e6),
        Parameter("camera_target", "vector", (0.0, 0.0, 1.0), "Point the camera looks at.", unit="m",
                  minimum=-1e6, maximum=1e6),
        Parameter("field_of_view", "float", 40.0, "Horizontal field of view.", unit="deg", minimum=1.0, maximum=150.0),
        Parameter("aspect", "float", 1.0, "Width of the picture over its height.", minimum=0.25, maximum=4.0),
        Parameter("exposure", "float", 0.0, "Exposure of the displayed picture; the EXR is not touched.",
                  unit="stops", minimum=-20.0, maximum=20.0),
        Parameter("sun_irradiance", "float", 0.0, "Irradiance of the sun on a surface that faces it; 0 leaves it out.",
                  unit="W/m2", minimum=0.0, maximum=1e6),
        Parameter("sun_color", "color", (1.0, 1.0, 1.0), "Colour of the sun.", minimum=0.0, maximum=1.0),
        Parameter("sun_elevation", "float", 45.0, "Height of the sun above the horizon.", unit="deg",
                  minimum=-90.0, maximum=90.0),
        Parameter("sun_azimuth", "float", 0.0, "Direction of the sun, from +y (north) towards +x (east).", unit="deg",
                  minimum=-360.0, maximum=360.0),
        Parameter("environment_color", "color", (1.0, 1.0, 1.0), "Colour of the uniform environment.",
                  minimum=0.0, maximum=1.0),
        Parameter("environment_radiance", "float", 0.0, "Radiance of the uniform environment.", unit="W/(m2 sr)",
                  minimum=0.0, maximum=1e6),
        Parameter("orders", "int", 1, "Orders of scattering that are followed: 1 is single scattering.",
                  minimum=1, maximum=1024),
    ),
)

PROP = Group(
    "props", "Prop", "An opaque body on the stage.",
    (
        Parameter("shape", "choice", "box", "Shape of the body.",
                  choices=(("box", "Box"), ("sphere", "Sphere"))),
        Parameter("location", "vector", (0.0, 0.0, 0.0), "Centre of the body.", unit="m", minimum=-1e6, maximum=1e6),
        Parameter("size", "vector", (1.0, 1.0, 1.0), "Full size along x, y and z; one of them may be 0 for a plane.",
                  unit="m", minimum=0.0, maximum=1e6),
        Parameter("rotation", "float", 0.0, "Rotation about the vertical axis.", unit="deg", minimum=-360.0, maximum=360.0),
        Parameter("albedo", "color", (0.5, 0.5, 0.5), "Diffuse (Lambert) reflectance.", minimum=0.0, maximum=1.0),
        Parameter("emission", "color", (0.0, 0.0, 0.0), "Emitted radiance, seen by the camera and through glass.",
                  unit="W/(m2 sr)", minimum=0.0, maximum=1e6),
    ),
)
