# SPDX-License-Identifier: GPL-3.0-or-later
"""Analytic clear sky of Preetham, Shirley and Smits, A practical analytic model for daylight, SIGGRAPH 1999.

The luminance and the chromaticities x and y of the sky are each a Perez function of the angles to zenith and sun,
scaled to a value at the zenith; all coefficients were fitted to simulated skies of turbidity 2 to 10, seen from the ground.
"""

import numpy as np

from . import checks

# Illuminance of the sun outside the atmosphere, klx. Source: Darula, Kittler and Gueymard, Reference luminous solar
# constant and solar luminance for illuminance calculations, Solar Energy 2005.
SOLAR_ILLUMINANCE = 133.3
# Luminous efficacy (lm/W) of radiation at 555 nm, by the definition of the candela.
MAX_LUMINOUS_EFFICACY = 683.0

# (slope, offset) in turbidity of the Perez coefficients A to E, for Y, x and y.
_PEREZ = np.array([
    [(0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)],
    [(-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)],
    [(-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)],
])
# Zenith chromaticity: rows in falling powers of turbidity, columns in falling powers of the sun's zenith angle.
_ZENITH_X = np.array([(0.00166, -0.00375, 0.00209, 0.0), (-0.02903, 0.06377, -0.03202, 0.00394),
                      (0.11693, -0.21196, 0.06052, 0.25886)])
_ZENITH_Y = np.array([(0.00275, -0.00610, 0.00317, 0.0), (-0.04214, 0.08970, -0.04153, 0.00516),
                      (0.15346, -0.26756, 0.06670, 0.26688)])
# XYZ to linear Rec.709, the inverse of its primaries and white point D65 (ITU-R BT.709).
_FROM_XYZ = np.linalg.inv([[0.4123907993, 0.3575843394, 0.1804807884], [0.2126390059, 0.7151686788, 0.0721923154],
                           [0.0193308187, 0.1191947798, 0.9505321522]])
_GRAZING = 1e-3  # least cosine to the zenith: towards the horizon the formula has its limit


def preetham_xyy(cos_theta, cos_gamma, sun_zenith, turbidity):
    """Chromaticities x and y and luminance Y (kcd/m^2) of the sky, shape (..., 3).

    cos_theta in [0, 1]: zenith cosine of the view; cos_gamma in [-1, 1]: cosine between view and sun; sun_zenith in
    [0, pi/2], the sun's zenith angle in radians; turbidity in [2, 10]. All broadcast.
    """
    cos_theta = checks.cosine("cos_theta", cos_theta)
    checks.checked("cos_theta", cos_theta, lambda c: c >= 0, ">= 0", "the sky ends at the horizon")
    cos_gamma = checks.cosine("cos_gamma", cos_gamma)
    sun_zenith = checks.checked("sun_zenith", sun_zenith, lambda a: (a >= 0) & (a <= np.pi / 2), "in [0, pi/2] radians",
                                "the sun must be up")
    turbidity = checks.checked("turbidity", turbidity, lambda t: (t >= 2) & (t <= 10), "in [2, 10]",
                               "2 is a very clear sky, 6 a hazy one")
    chi = (4 / 9 - turbidity / 120) * (np.pi - 2 * sun_zenith)
    luminance = (4.0453 * turbidity - 4.9710) * np.tan(chi) - 0.2155 * turbidity + 2.4192
    angles = np.stack(np.broadcast_arrays(sun_zenith**3, sun_zenith**2, sun_zenith, 1.0), axis=-1)
    powers = np.stack(np.broadcast_arrays(turbidity**2, turbidity, 1.0), axis=-1)
    x, y = (np.einsum("...i,ij,...j->...", powers, matrix, angles) for matrix in (_ZENITH_X, _ZENITH_Y))
    gamma = np.arccos(cos_gamma)
    value = []
    for zenith, coefficients in zip((luminance, x, y), _PEREZ):
        a, b, c, d, e = (slope * turbidity + offset for slope, offset in coefficients)

        def perez(cosine, angle):
            near_sun = 1 + c * np.exp(d * angle) + e * np.cos(angle) ** 2
            return (1 + a * np.exp(b / np.maximum(cosine, _GRAZING))) * near_sun

        value.append(zenith * perez(cos_theta, gamma) / perez(1.0, sun_zenith))
    return np.stack(np.broadcast_arrays(value[1], value[2], np.maximum(value[0], 0.0)), axis=-1)


def preetham_sky(cos_theta, cos_gamma, sun_zenith, turbidity):
    """Sky radiance in linear Rec.709, shape (..., 3), W m^-2 sr^-1; arguments as in ``preetham_xyy``.

    Y (kcd/m^2) is turned into radiance with 683 lm/W: 0.2126 R + 0.7152 G + 0.0722 B = 1000 Y / 683, the radiance of
    light at 555 nm that is as bright. So scaled, the sun outside the atmosphere has 1000 SOLAR_ILLUMINANCE / 683 = 195
    W/m^2; multiply by another sun's irradiance over that. Colours outside Rec.709 are cut to 0.
    """
    x, y, luminance = np.moveaxis(preetham_xyy(cos_theta, cos_gamma, sun_zenith, turbidity), -1, 0)
    over_y = luminance / y
    xyz = np.stack([x * over_y, luminance, (1 - x - y) * over_y], axis=-1)
    return np.maximum(xyz @ _FROM_XYZ.T, 0.0) * (1000 / MAX_LUMINOUS_EFFICACY)
