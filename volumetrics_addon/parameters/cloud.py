# SPDX-License-Identifier: GPL-3.0-or-later
"""Cloud: a scattering medium in an ellipsoid or a box, homogeneous or shaped by noise."""

from .model import Group, Parameter
from .shared import ALBEDO, EXTINCTION, G, LOCATION, SIZE, having

CLOUD = Group(
    "cloud", "Cloud", "Scattering medium with one or two Henyey-Greenstein lobes, homogeneous or noise-shaped.",
    (
        LOCATION,
        having(SIZE, (200.0, 200.0, 100.0)),
        Parameter("domain", "choice", "ellipsoid", "Shape of the domain that holds the medium.",
                  choices=(("ellipsoid", "Ellipsoid"), ("box", "Box"))),
        EXTINCTION,
        having(ALBEDO, (0.999, 0.999, 0.999)),
        Parameter("phase", "choice", "dual_hg", "Phase function. EEVEE has one lobe and gets the mean cosine of both.",
                  choices=(("hg", "One HG lobe"), ("dual_hg", "Two HG lobes"))),
        having(G, 0.8),
        Parameter("g_back", "float", -0.2, "Mean cosine of the second lobe.", title="Second anisotropy",
                  minimum=-0.999, maximum=0.999, live=True),
        Parameter("lobe_weight", "float", 0.2, "Share of the second lobe: (1 - weight) HG(g) + weight HG(g_back).",
                  minimum=0.0, maximum=1.0, live=True),
        Parameter("density", "choice", "noise", "Density inside the domain.",
                  choices=(("homogeneous", "Homogeneous"), ("noise", "Noise"))),
        Parameter("noise_size", "float", 60.0, "Size of the largest billows.",
                  unit="m", minimum=1e-4, maximum=1e6, soft_minimum=0.01, soft_maximum=1e3, live=True),
        Parameter("noise_detail", "float", 4.0, "Number of finer octaves of noise.",
                  minimum=0.0, maximum=8.0, live=True),
        Parameter("noise_roughness", "float", 0.55, "Strength of each octave relative to the one before.",
                  minimum=0.0, maximum=1.0, live=True),
        Parameter("noise_strength", "float", 1.0, "How far the noise carves into the shape; 0 leaves the smooth shape.",
                  minimum=0.0, maximum=4.0, live=True),
        Parameter("fill", "float", 0.5, "How much of the domain is filled: raises the density everywhere.",
                  minimum=-1.0, maximum=2.0, soft_minimum=0.0, soft_maximum=1.0, live=True),
        Parameter("softness", "float", 0.25, "Width of the transition from clear air to full density; small is crisp.",
                  minimum=0.01, maximum=4.0, soft_maximum=1.0, live=True),
        Parameter("seed", "int", 0, "Another number, another cloud of the same kind.",
                  minimum=0, maximum=9999, live=True),
        Parameter("eevee_light", "choice", "baked", "Light in EEVEE: all orders of scattering, baked for lights and camera as they "
                  "are, or EEVEE's own single scattering with one lobe.", title="EEVEE light",
                  choices=(("baked", "Baked"), ("scatter", "Scattered once"))),
        Parameter("light_resolution", "int", 32, "Voxels of the baked light along the longest side of the domain.",
                  minimum=4, maximum=128, soft_minimum=16, soft_maximum=64),
    ),
)
