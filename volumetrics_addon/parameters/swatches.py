# SPDX-License-Identifier: GPL-3.0-or-later
"""Absorption of real materials: coefficients (1/m) in linear Rec.709 channels, each with its source.

Where a spectrum was measured, a channel has the coefficient at one wavelength near the maximum of its primary: 610, 550 and
465 nm. From an index of refraction n + i k it is 4 pi k / wavelength. Where no spectrum is at hand, a colour at a thickness
stands for the material, and the source says that it was judged by eye.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

WAVELENGTHS = (610e-9, 550e-9, 465e-9)  # m, of red, green and blue

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Swatch:
    """``sigma_a``: absorption coefficients in 1/m; ``source``: where they are from."""

    label: str
    sigma_a: Color
    source: str


def _from_index(label: str, k: Color, source: str) -> Swatch:
    return Swatch(label, tuple(4.0 * math.pi * part / wavelength for part, wavelength in zip(k, WAVELENGTHS)), source)


def _from_color(label: str, color: Color, distance: float) -> Swatch:
    return Swatch(label, tuple(-math.log(c) / distance for c in color),
                  f"by eye: linear colour {', '.join(f'{c:g}' for c in color)} after {1e3 * distance:g} mm")


RUBIN = "imaginary index of {} soda-lime window glass: M. Rubin, Sol. Energy Mater. 12, 275-288 (1985)"
NARASIMHAN = ("measured by dilution, undiluted {}: S. G. Narasimhan et al., Acquiring Scattering Properties of Participating Media "
              "by Dilution (2006); the little scattering is left out")

SWATCHES: dict[str, Swatch] = {
    "float_glass": _from_index("Clear float glass", (5.217e-7, 2.200e-7, 1.685e-7), RUBIN.format("clear")),
    "green_float": _from_index("Green float glass", (2.508e-6, 1.169e-6, 8.584e-7), RUBIN.format("green")),
    "bronze_float": _from_index("Bronze float glass", (3.929e-6, 3.725e-6, 4.425e-6), RUBIN.format("bronze")),
    "smoked_float": _from_index("Grey (smoked) float glass", (6.654e-6, 4.913e-6, 4.546e-6), RUBIN.format("grey")),
    "bottle_green": _from_color("Bottle green", (0.30, 0.62, 0.20), 0.004),
    "amber": _from_color("Amber bottle", (0.72, 0.30, 0.04), 0.003),
    "cobalt": _from_color("Cobalt blue", (0.05, 0.14, 0.70), 0.003),
    "ruby": _from_color("Ruby", (0.70, 0.03, 0.025), 0.003),
    "water": Swatch("Pure water", (0.2644, 0.0565, 0.01011),
                    "R. M. Pope and E. S. Fry, Appl. Opt. 36, 8710-8723 (1997)"),
    "sea_water": Swatch("Sea water, Jerlov III", (0.327, 0.120, 0.124),
                        "attenuation of downward irradiance, oceanic type III: N. G. Jerlov, Marine Optics (1976), table XXVII; "
                        "it includes what is scattered back"),
    "coastal_water": Swatch("Coastal water, Jerlov 3", (0.358, 0.190, 0.330),
                            "attenuation of downward irradiance, coastal type 3: N. G. Jerlov, Marine Optics (1976), table XXVII; "
                            "it includes what is scattered back"),
    "merlot": Swatch("Red wine (Merlot)", (116.32, 251.91, 294.34), NARASIMHAN.format("Merlot")),
    "beer": Swatch("Beer", (11.492, 24.911, 57.786), NARASIMHAN.format("Budweiser")),
    "cola": Swatch("Cola", (100.14, 165.03, 246.8), NARASIMHAN.format("Coke")),
    "tea": _from_color("Black tea", (0.72, 0.32, 0.06), 0.1),
}
