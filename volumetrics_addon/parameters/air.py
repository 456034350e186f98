# SPDX-License-Identifier: GPL-3.0-or-later
"""Air: a planet's molecules and aerosol, whose densities fall exponentially with the altitude above a round ground.

The defaults are the Earth's: Rayleigh coefficients at 680, 550 and 440 nm and the aerosol of Bruneton and Neyret,
Precomputed atmospheric scattering, EGSR 2008.
"""

from .model import Group, Parameter
from .shared import REALISATION, G, having

AIR = Group(
    "air", "Air", "A planet's air over its round ground: molecules (Rayleigh) and aerosol (Mie), thinner with altitude.",
    (
        Parameter("rayleigh_scattering", "float", 0.0331, "Scattering coefficient of the molecules at the ground, in the "
                  "channel where it is largest.",
                  unit="1/km", minimum=0.0, maximum=1e3, soft_maximum=1.0, live=True),
        Parameter("rayleigh_color", "color", (0.1753, 0.4096, 1.0), "Scattering coefficient of the molecules in each channel, "
                  "relative to the largest.",
                  minimum=0.0, maximum=1.0, live=True),
        Parameter("rayleigh_scale_height", "float", 8500.0, "Altitude over which the molecules' density falls to 1/e.",
                  unit="m", minimum=1.0, maximum=1e6, soft_minimum=100.0, soft_maximum=1e5, live=True),
        Parameter("mie_extinction", "float", 0.004436, "Extinction coefficient of the aerosol at the ground: haze.",
                  unit="1/km", minimum=0.0, maximum=1e3, soft_maximum=1.0, live=True),
        Parameter("mie_albedo", "color", (0.9008, 0.9008, 0.9008), "Single-scattering albedo of the aerosol.",
                  minimum=0.0, maximum=1.0, live=True),
        having(G, 0.76, name="mie_g", title="Mie anisotropy g",
               description="Mean cosine of the aerosol's Henyey-Greenstein phase function. EEVEE has one lobe and gets the mean "
               "of aerosol and molecules."),
        Parameter("mie_scale_height", "float", 1200.0, "Altitude over which the aerosol's density falls to 1/e.",
                  unit="m", minimum=1.0, maximum=1e6, soft_minimum=100.0, soft_maximum=1e5, live=True),
        REALISATION,
        Parameter("planet_radius", "float", 6.36e6, "Radius of the planet's ground.",
                  unit="m", minimum=1e4, maximum=1e9, soft_minimum=1e6, soft_maximum=1e8),
        Parameter("base_height", "float", 0.0, "Height of the ground at the origin; it falls away from there to all sides.",
                  unit="m", minimum=-1e5, maximum=1e5),
        Parameter("thickness", "float", 60_000.0, "Altitude at which the air ends.",
                  unit="m", minimum=100.0, maximum=1e6, soft_minimum=1e3, soft_maximum=2e5),
        Parameter("reach", "float", 900_000.0, "How far from the origin the engines follow the air. A line of sight to the "
                  "horizon leaves the Earth's air after 900 km.",
                  unit="m", minimum=1e3, maximum=1e9, soft_minimum=1e4, soft_maximum=2e6),
        Parameter("ground_albedo", "color", (0.1, 0.1, 0.1), "Diffuse (Lambert) reflectance of the planet's ground.",
                  minimum=0.0, maximum=1.0),
    ),
)
