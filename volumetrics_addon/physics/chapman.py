# SPDX-License-Identifier: GPL-3.0-or-later
"""The Chapman function: how much longer the way to a low sun is through an exponential atmosphere than straight up."""

import numpy as np

from . import checks

ERFCX = 2.9110  # of the approximation of exp(y^2) erfc(y), error 0.33 %: Ren and MacKenzie, Adv. Atmos. Sci. 24, 2007


def chapman(x, mu):
    """Optical depth towards zenith cosine mu over the vertical one, x scale heights from the planet's centre.

    Ch = (pi x / 2)^(1/2) exp(y^2) erfc(y), y = mu (x / 2)^(1/2), which is exact for x -> infinity; the exponential times erfc
    is a / ((a - 1) pi^(1/2) y + (pi y^2 + a^2)^(1/2)). Error below 1 % for x > 300 (the Earth's air has 750).
    x > 0; mu in [0, 1]. Raises ValueError out of range.
    """
    x = checks.positive("x", x, "scale heights", "give the distance from the planet's centre")
    mu = checks.fraction("mu", mu, "give a direction above the horizon")
    with np.errstate(under="ignore"):
        level = np.sqrt(np.pi) * np.sqrt(x / 2.0)
        y = mu * level
        return level * ERFCX / ((ERFCX - 1.0) * y + np.hypot(y, ERFCX))
