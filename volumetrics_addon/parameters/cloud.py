# SPDX-License-Identifier: GPL-3.0-or-later
"""Cloud: a scattering medium in an ellipsoid or a box, homogeneous or shaped by noise and billows."""

from .model import Group, Parameter
from .shared import ALBEDO, EXTINCTION, G, LOCATION, SIZE, having

NOISE, BILLOWS, OCTAVES = ("density", "noise"), ("billow_octaves",), ("scattering", "octaves")  # what has an effect beside what

CLOUD = Group(
    "cloud", "Cloud", "Scattering medium of water droplets or with Henyey-Greenstein lobes, homogeneous or noise-shaped.",
    (
        LOCATION,
        having(SIZE, (200.0, 200.0, 100.0)),
        Parameter("domain", "choice", "ellipsoid", "Shape of the domain that holds the medium.",
                  choices=(("ellipsoid", "Ellipsoid"), ("box", "Box"))),
        EXTINCTION,
        having(ALBEDO, (0.999, 0.999, 0.999)),
        Parameter("phase", "choice", "dual_hg", "Phase function. EEVEE has one lobe and gets the mean cosine of both.",
                  choices=(("hg", "One HG lobe"), ("dual_hg", "Two HG lobes"), ("mie", "Water droplets"))),
        having(G, 0.8, when=("phase", "hg", "dual_hg")),
        Parameter("g_back", "float", -0.2, "Mean cosine of the second lobe.", title="Second anisotropy",
                  minimum=-0.999, maximum=0.999, live=True, when=("phase", "dual_hg")),
        Parameter("lobe_weight", "float", 0.2, "Share of the second lobe: (1 - weight) HG(g) + weight HG(g_back).",
                  minimum=0.0, maximum=1.0, live=True, when=("phase", "dual_hg")),
        Parameter("droplet_diameter", "float", 12.0, "Diameter of the water droplets: fog and young clouds have small ones, which "
                  "scatter a little less sharply.", unit="um", minimum=5.0, maximum=50.0, live=True, when=("phase", "mie")),
        Parameter("scattering", "choice", "full", "How Cycles follows light inside: in full, or with a few octaves that stand for "
                  "many orders: quicker for thin clouds, 11 % to 17 % too dark in thick ones.",
                  choices=(("full", "All orders"), ("octaves", "Octaves"))),
        Parameter("octaves", "int", 12, "Scattering events that are followed when scattering is by octaves.",
                  minimum=1, maximum=64, when=OCTAVES),
        Parameter("octave_extinction", "float", 0.85, "Extinction of each octave relative to the one before.",
                  minimum=0.0, maximum=1.0, live=True, when=OCTAVES),
        Parameter("octave_phase", "float", 0.7, "Mean cosine of each octave relative to the one before.",
                  minimum=0.0, maximum=1.0, live=True, when=OCTAVES),
        Parameter("octave_contribution", "float", 0.85, "Scattering of each octave relative to the one before, at most its "
                  "extinction.", minimum=0.0, maximum=1.0, live=True, when=OCTAVES),
        Parameter("density", "choice", "noise", "Density inside the domain.",
                  choices=(("homogeneous", "Homogeneous"), ("noise", "Noise"))),
        Parameter("representation", "choice", "automatic", "Nodes stay live and sharp at any distance; voxels render sooner and fix "
                  "the shape. Automatic: nodes in your own scene, else voxels.",
                  choices=(("automatic", "Automatic"), ("procedural", "Nodes"), ("baked", "Voxels")), when=NOISE),
        Parameter("resolution", "int", 128, "Voxels along the longest side of the cloud.",
                  minimum=8, maximum=512, when=NOISE),
        Parameter("profile", "choice", "round", "Shape of the body that the noise is cut from.",
                  choices=(("round", "Round"), ("dome", "Dome on a flat floor"), ("tower", "Tower on a flat floor"),
                           ("anvil", "Tower under an anvil"), ("layer", "Flat layer")), when=NOISE),
        Parameter("fill", "float", 0.5, "How much of the domain is filled: raises the density everywhere.", title="Coverage",
                  minimum=-1.0, maximum=2.0, soft_minimum=0.0, soft_maximum=1.0, live=True, when=NOISE),
        Parameter("softness", "float", 0.25, "Width of the transition from clear air to full density; small is crisp.",
                  minimum=0.01, maximum=4.0, soft_maximum=1.0, live=True, when=NOISE),
        Parameter("base", "float", 0.0, "Share of the height over which the density rises from a flat floor; 0: no floor.",
                  title="Flat base", minimum=0.0, maximum=1.0, soft_maximum=0.3, when=NOISE),
        Parameter("noise_size", "float", 60.0, "Size of the largest features of the noise.",
                  unit="m", minimum=1e-4, maximum=1e6, soft_minimum=0.01, soft_maximum=1e3, live=True, when=NOISE),
        Parameter("noise_detail", "float", 4.0, "Number of finer octaves of noise.",
                  minimum=0.0, maximum=8.0, live=True, when=NOISE),
        Parameter("noise_roughness", "float", 0.55, "Strength of each octave relative to the one before.",
                  minimum=0.0, maximum=1.0, live=True, when=NOISE),
        Parameter("noise_strength", "float", 1.0, "How far the noise carves into the shape; 0 leaves the smooth shape.",
                  minimum=0.0, maximum=4.0, live=True, when=NOISE),
        Parameter("billow_octaves", "int", 0, "Octaves of rounded bulges with creases between them, as on a cauliflower; "
                  "0 leaves them out.", minimum=0, maximum=6, when=NOISE),
        Parameter("billow_size", "float", 30.0, "Size of the largest bulges.",
                  unit="m", minimum=1e-4, maximum=1e6, soft_minimum=0.01, soft_maximum=1e3, live=True, when=BILLOWS),
        Parameter("billow_strength", "float", 0.5, "How far the bulges rise; below 0 they are hollows between wisps.",
                  minimum=-4.0, maximum=4.0, soft_minimum=-2.0, soft_maximum=2.0, live=True, when=BILLOWS),
        Parameter("billow_roughness", "float", 0.5, "Strength of each octave of bulges relative to the one before.",
                  minimum=0.0, maximum=1.0, live=True, when=BILLOWS),
        Parameter("stretch", "float", 1.0, "Draws the noise out along x: streaks of ice or of mist.",
                  minimum=0.01, maximum=100.0, soft_minimum=1.0, soft_maximum=10.0, live=True, when=NOISE),
        Parameter("wind", "vector", (0.0, 0.0, 0.0), "Speed at which the noise drifts through the body.",
                  unit="m/s", minimum=-1e3, maximum=1e3, live=True, when=NOISE),
        Parameter("time", "float", 0.0, "Seconds that the wind has blown: keyframe it to let the cloud drift.",
                  unit="s", minimum=-1e6, maximum=1e6, soft_minimum=0.0, soft_maximum=600.0, live=True, when=NOISE),
        Parameter("evolution", "float", 0.0, "Age of the cloud: its features rise through one another; keyframe it to let the "
                  "cloud boil.", minimum=-1e3, maximum=1e3, soft_minimum=0.0, soft_maximum=10.0, live=True, when=NOISE),
        Parameter("seed", "int", 0, "Another number, another cloud of the same kind.",
                  minimum=0, maximum=9999, live=True, when=NOISE),
        Parameter("eevee_light", "choice", "baked", "Light in EEVEE: all orders of scattering, baked for lights and camera as they "
                  "are, or EEVEE's own single scattering with one lobe.", title="EEVEE light",
                  choices=(("baked", "Baked"), ("scatter", "Scattered once"))),
        Parameter("light_resolution", "int", 32, "Voxels of the baked light along the longest side of the domain.",
                  minimum=4, maximum=128, soft_minimum=16, soft_maximum=64, when=("eevee_light", "baked")),
    ),
)
