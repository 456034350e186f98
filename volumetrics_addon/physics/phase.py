# SPDX-License-Identifier: GPL-3.0-or-later
"""Phase functions: how a medium distributes scattered light over directions.

``cos_theta`` is the cosine between the light's direction of travel before and
after scattering, +1 forward; g > 0 is forward. Values are per steradian and
integrate to 1 over the sphere. All arguments broadcast, computation is float64.

Beside each function stand

``sample_<name>(u, ...)``
    maps uniform numbers u in [0, 1] to cos_theta. The density in solid angle is
    the phase function itself (2 pi times it in cos_theta). Single lobes are
    exact inversions of the distribution function and increase with u: u = 0 is
    backward, u = 1 forward. Mixtures choose a lobe with u and reuse the rest.
``mean_cosine_<name>(...)``
    the mean of cos_theta, the asymmetry parameter.

Every function raises ValueError for NaN and for arguments out of range.
"""

import numpy as np

from . import checks
from .quadrature import gauss_legendre

_ISOTROPIC = 1 / (4 * np.pi)

# Gauss-Legendre on [0, 1]: 12 nodes integrate the entire functions below, over
# an exponent of at most 1, to the last bit; 16 do so over panels of length 3.
_NODES_12, _WEIGHTS_12 = gauss_legendre(12, -0.5, 0.5)
_NODES_12 = _NODES_12 + 0.5
_NODES_16, _WEIGHTS_16 = gauss_legendre(16, -0.5, 0.5)
_NODES_16 = _NODES_16 + 0.5


# --- isotropic ---------------------------------------------------------------


def isotropic(cos_theta):
    """Isotropic scattering, p = 1 / (4 pi) per steradian.

    cos_theta: any shape, in [-1, 1]. Returns the same shape.
    """
    return np.full_like(checks.cosine("cos_theta", cos_theta), _ISOTROPIC)[()]


def sample_isotropic(u):
    """cos_theta = 2 u - 1 for u in [0, 1], any shape."""
    return 2 * _uniform(u) - 1


def mean_cosine_isotropic():
    """Mean cosine of isotropic scattering: 0."""
    return 0.0


# --- Rayleigh ----------------------------------------------------------------


def rayleigh(cos_theta):
    """Rayleigh scattering of unpolarised light, p = 3 (1 + c^2) / (16 pi) per steradian.

    cos_theta: any shape, in [-1, 1]. Returns the same shape.
    Source: Lord Rayleigh 1871; Chandrasekhar, Radiative Transfer, section 16.
    """
    c = checks.cosine("cos_theta", cos_theta)
    return 3 * _ISOTROPIC / 4 * (1 + c * c)


def sample_rayleigh(u):
    """cos_theta of Rayleigh scattering for u in [0, 1], any shape.

    The distribution function is cubic, c^3 + 3 c = 8 u - 4. Cardano's root
    A - 1/A is written 2 sinh(asinh(4 u - 2) / 3), which has no cancellation.
    Source: Frisvad, Importance sampling the Rayleigh phase function, JOSA A 2011.
    """
    return np.clip(2 * np.sinh(np.arcsinh(4 * _uniform(u) - 2) / 3), -1.0, 1.0)


def mean_cosine_rayleigh():
    """Mean cosine of Rayleigh scattering: 0."""
    return 0.0


# --- Henyey-Greenstein -------------------------------------------------------


def henyey_greenstein(cos_theta, g):
    """Henyey-Greenstein, p = (1 - g^2) / (4 pi (1 + g^2 - 2 g c)^(3/2)) per steradian.

    cos_theta in [-1, 1] and g in (-1, 1) broadcast. Relative error below 1e-14
    for all g, 1 - 1e-12 included: the textbook denominator cancels near the peak
    and is written (1 - |g|)^2 + 2 |g| (1 -+ c) instead.
    Source: Henyey and Greenstein, Astrophysical Journal 93 (1941).
    """
    return _henyey_greenstein(checks.cosine("cos_theta", cos_theta), _asymmetry("g", g))[()]


def sample_henyey_greenstein(u, g):
    """cos_theta of Henyey-Greenstein for u in [0, 1] and g in (-1, 1), broadcasting.

    c = 1 - 2 (1-g)^2 (1-u) (1+gu) / (1-g+2gu)^2 for g >= 0, mirrored for g < 0:
    the usual inversion with the division by g carried out, exact for g = 0.
    """
    u, g = np.broadcast_arrays(_uniform(u), _asymmetry("g", g))
    return _signed(_sample_forward_lobe(*_along_lobe(u, g), np.abs(g)), g)[()]


def mean_cosine_henyey_greenstein(g):
    """Mean cosine of Henyey-Greenstein: g itself."""
    return _asymmetry("g", g)[()]


def _henyey_greenstein(c, g):
    size = np.abs(g)
    gap = 1 - size
    denominator = gap * gap + 2 * size * (1 - _signed(c, g))
    return _ISOTROPIC * gap * (1 + size) / (denominator * np.sqrt(denominator))


def _sample_forward_lobe(u, complement, g):
    """cos_theta for g >= 0, with complement = 1 - u passed so that neither end loses digits."""
    gap = 1 - g
    ratio = gap / (gap + 2 * g * u)
    return 1 - 2 * ratio * ratio * complement * (1 + g * u)


def _along_lobe(u, g):
    """(u, 1 - u) as seen from a forward lobe: a backward one is its mirror image."""
    backward = g < 0
    return np.where(backward, 1 - u, u), np.where(backward, u, 1 - u)


def _signed(c, g):
    return np.where(g < 0, -c, c)


# --- two Henyey-Greenstein lobes ---------------------------------------------


def dual_henyey_greenstein(cos_theta, g0, g1, weight):
    """Two lobes, p = (1 - weight) HG(g0) + weight HG(g1) per steradian.

    cos_theta in [-1, 1], g0 and g1 in (-1, 1), weight in [0, 1]; all broadcast.
    """
    c = checks.cosine("cos_theta", cos_theta)
    g0, g1, weight = _two_lobes(g0, g1, weight)
    return ((1 - weight) * _henyey_greenstein(c, g0) + weight * _henyey_greenstein(c, g1))[()]


def sample_dual_henyey_greenstein(u, g0, g1, weight):
    """cos_theta of two lobes: u < weight takes lobe g1, what is left of u samples the lobe."""
    u = _uniform(u)
    g0, g1, weight = _two_lobes(g0, g1, weight)
    second, u = _choose_lobe(u, weight)
    return sample_henyey_greenstein(u, np.where(second, g1, g0))


def mean_cosine_dual_henyey_greenstein(g0, g1, weight):
    """Mean cosine of two lobes: (1 - weight) g0 + weight g1."""
    g0, g1, weight = _two_lobes(g0, g1, weight)
    return (1 - weight) * g0 + weight * g1


def _two_lobes(g0, g1, weight):
    return _asymmetry("g0", g0), _asymmetry("g1", g1), checks.fraction("weight", weight)


def _choose_lobe(u, weight):
    """Whether u falls to the second lobe, and the uniform number that is left of it."""
    u, weight = np.broadcast_arrays(u, weight)
    second = u < weight
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rest = np.where(second, u / weight, (u - weight) / (1 - weight))
    # weight = u = 1 leaves 0/0 for a lobe that has no share.
    return second, np.where(rest <= 1, rest, 1.0)


# --- Schlick -----------------------------------------------------------------


def schlick(cos_theta, k):
    """Schlick's rational lobe, p = (1 - k^2) / (4 pi (1 - k c)^2) per steradian.

    cos_theta in [-1, 1] and k in (-1, 1) broadcast; k > 0 is forward. The
    denominator is formed as ((1 - |k|) + |k| (1 -+ c))^2.
    Source: Blasi, Le Saec and Schlick, Computer Graphics Forum 12 (1993).
    """
    c = checks.cosine("cos_theta", cos_theta)
    k = _schlick_parameter(k)
    size = np.abs(k)
    gap = 1 - size
    denominator = gap + size * (1 - _signed(c, k))
    return (_ISOTROPIC * gap * (1 + size) / (denominator * denominator))[()]


def schlick_k(g):
    """Schlick's k that resembles Henyey-Greenstein of mean cosine g: 1.55 g - 0.55 g^3.

    g of any shape, |g| < 0.93811: from there on the cubic leaves |k| < 1, the
    range in which Schlick's function exists, and ValueError is raised.
    """
    g = _asymmetry("g", g)
    k = 1.55 * g - 0.55 * g * g * g
    beyond = np.abs(k) >= 1
    checks.checked(
        "g",
        g,
        lambda _: ~beyond,
        "below 0.93811 in size, or Schlick's k reaches 1",
        "use henyey_greenstein for sharper lobes",
    )
    return k


def sample_schlick(u, k):
    """cos_theta of Schlick's lobe for u in [0, 1] and k in (-1, 1), broadcasting.

    c = (2u - 1 + k) / (1 + k (2u - 1)), with the distance to the peak as a
    product, 1 - c = 2 (1 - k) (1 - u) / (1 - k + 2 k u).
    """
    u, k = np.broadcast_arrays(_uniform(u), _schlick_parameter(k))
    size = np.abs(k)
    gap = 1 - size
    u, complement = _along_lobe(u, k)
    return _signed(1 - 2 * gap * complement / (gap + 2 * size * u), k)[()]


def mean_cosine_schlick(k):
    """Mean cosine of Schlick's lobe, 1/k - (1 - k^2) artanh(k) / k^2.

    k in (-1, 1), any shape. Below |k| = 1/2 the two terms cancel and the power
    series sum 2 k^(2j+1) / ((2j+1) (2j+3)) takes their place.
    """
    k = _schlick_parameter(k)
    small = np.abs(k) < 0.5
    large = np.where(small, 0.5, k)
    closed = 1 / large - (1 - large) * (1 + large) * np.arctanh(large) / (large * large)
    square = np.where(small, k * k, 0.0)
    series = np.zeros_like(square)
    for j in reversed(range(28)):
        series = series * square + 2 / ((2 * j + 1) * (2 * j + 3))
    return np.where(small, k * series, closed)[()]


def _schlick_parameter(k):
    return checks.checked(
        "k",
        k,
        lambda x: np.abs(x) < 1,
        "in (-1, 1)",
        "take it from schlick_k(g), or use henyey_greenstein for sharper lobes",
    )


# --- Draine and Cornette-Shanks ----------------------------------------------


def draine(cos_theta, g, alpha):
    """Draine's phase function, p = HG(c; g) (1 + alpha c^2) / (1 + alpha (1 + 2 g^2) / 3).

    cos_theta in [-1, 1], g in (-1, 1), alpha >= 0; all broadcast; per steradian.
    alpha = 0 is Henyey-Greenstein, alpha = 1 Cornette-Shanks, g = 0 and alpha = 1
    Rayleigh. g is not the mean cosine unless alpha = 0.
    Source: Draine, Astrophysical Journal 598 (2003).
    """
    c = checks.cosine("cos_theta", cos_theta)
    return _draine(c, _asymmetry("g", g), _draine_alpha(alpha))[()]


def sample_draine(u, g, alpha):
    """cos_theta of Draine's function for u in [0, 1], g in (-1, 1), alpha >= 0, broadcasting.

    With t the value of the Henyey-Greenstein distribution function, Draine's is
    t (1 + alpha m(t)) / (1 + alpha (1 + 2 g^2) / 3), where m(t) is the mean of c^2
    over [0, t], a polynomial in t / (1 - g + 2 g t). It is solved for t by
    Newton's method kept inside a bracket; unlike the published closed inverse it
    has no division by g or alpha and keeps full precision.
    """
    u, g, alpha = np.broadcast_arrays(_uniform(u), _asymmetry("g", g), _draine_alpha(alpha))
    size = np.abs(g)
    forward_u, backward_u = _along_lobe(u, g)
    flat, squared = _draine_shares(size, alpha)
    parameters = (size, flat, squared)
    t = _invert(_draine_distribution, _draine_density, forward_u, 0, 1, forward_u, parameters)
    # The end exactly, where rounding of the distribution stops the search short of it.
    t = np.where(backward_u == 0, 1.0, t)
    return _signed(_sample_forward_lobe(t, 1 - t, size), g)[()]


def mean_cosine_draine(g, alpha):
    """Mean cosine of Draine's function; arguments as in draine.

    g (1 + alpha (3 + 2 g^2) / 5) / (1 + alpha (1 + 2 g^2) / 3)
    """
    g, alpha = _asymmetry("g", g), _draine_alpha(alpha)
    flat, squared = _draine_shares(g, alpha)
    return g * (flat + squared * ((3 + 2 * g * g) / 5))


def cornette_shanks(cos_theta, g):
    """Cornette-Shanks, p = 3 (1-g^2) (1+c^2) / (8 pi (2+g^2) (1+g^2-2gc)^(3/2)) per steradian.

    cos_theta in [-1, 1] and g in (-1, 1) broadcast. It is Draine's function with
    alpha = 1, and Rayleigh's at g = 0.
    Source: Cornette and Shanks, Applied Optics 31 (1992).
    """
    return draine(cos_theta, g, 1.0)


def sample_cornette_shanks(u, g):
    """cos_theta of Cornette-Shanks for u in [0, 1] and g in (-1, 1), see sample_draine."""
    return sample_draine(u, g, 1.0)


def mean_cosine_cornette_shanks(g):
    """Mean cosine of Cornette-Shanks, 3 g (4 + g^2) / (5 (2 + g^2)); larger in size than g."""
    return mean_cosine_draine(g, 1.0)


def _draine(c, g, alpha):
    flat, squared = _draine_shares(g, alpha)
    return _henyey_greenstein(c, g) * (flat + squared * c * c)


def _draine_shares(g, alpha):
    """1 / n and alpha / n with the norm n = 1 + alpha (1 + 2 g^2) / 3: finite for any alpha."""
    norm = 1 + alpha * ((1 + 2 * g * g) / 3)
    return 1 / norm, alpha / norm


def _draine_distribution(t, g, flat, squared):
    return t * (flat + squared * _mean_square_cosine(t, g))


def _draine_density(t, g, flat, squared):
    c = _sample_forward_lobe(t, 1 - t, g)
    return flat + squared * c * c


def _mean_square_cosine(t, g):
    """Mean of c^2 over the share t of Henyey-Greenstein's backward end, g >= 0.

    c is rational in d = 1 - g + 2 g t, so its square integrates in closed form;
    the result is expanded in r = t / d, which removes the factor 1 / g^2.
    """
    r = t / ((1 - g) + 2 * g * t)
    h = g * r
    a = 1 + g * g
    constant = 1 + h * (-4 + h * (16 / 3 - h * (8 / 3)))
    linear = r * (-2 + h * (16 / 3 - h * (8 / 3)))
    quadratic = r * r * (4 / 3 - h * (2 / 3))
    return constant + a * (linear + a * quadratic)


def _draine_alpha(alpha):
    return checks.nonnegative("alpha", alpha, "without unit", "use 0 for plain Henyey-Greenstein")


# --- water droplets (Mie) ----------------------------------------------------


def mie_fit_parameters(droplet_diameter):
    """Parameters (g_hg, g_draine, alpha, weight) of the droplet fit, each of the input's shape.

    droplet_diameter in micrometres, in (0, 50]. The fit's main range is 5 to 50
    (fog and cloud); the three ranges below it come from the supplement. They meet
    at 0.1 and 5 micrometres within a few per cent but jump at 1.5, in the
    published fit itself. Towards 0 the function tends to Rayleigh's within 1 %.
    Cycles writes 0.3764 for the 0.376475 of the range from 1.5 to 5.
    Source: Jendersie and d'Eon, An Approximate Mie Scattering Function for Fog
    and Cloud Rendering, SIGGRAPH 2023 Talks, and its supplement.
    """
    d = checks.checked(
        "droplet_diameter",
        droplet_diameter,
        lambda x: (x > 0) & (x <= 50),
        "in (0, 50] micrometres",
        "the fit ends at 50; larger drops are geometric optics",
    )
    ranges = (
        (d <= 0.1, _mie_below_tenth),
        ((d > 0.1) & (d < 1.5), _mie_below_one_and_half),
        ((d >= 1.5) & (d < 5), _mie_below_five),
        (d >= 5, _mie_fog_and_cloud),
    )
    parameters = tuple(np.empty_like(d) for _ in range(4))
    for inside, fit in ranges:
        for parameter, value in zip(parameters, fit(d[inside])):
            parameter[inside] = value
    return tuple(parameter[()] for parameter in parameters)


def mie_fit(cos_theta, droplet_diameter):
    """Fit of Mie scattering by water droplets, (1 - w) HG(g_hg) + w Draine(g_draine, alpha).

    cos_theta in [-1, 1] and droplet_diameter in (0, 50] micrometres broadcast;
    per steradian; parameters from mie_fit_parameters. The fit has no fog-bow and
    no glory and is 0.01 to 0.02 above the true mean cosine.
    """
    c = checks.cosine("cos_theta", cos_theta)
    g_hg, g_draine, alpha, weight = mie_fit_parameters(droplet_diameter)
    return ((1 - weight) * _henyey_greenstein(c, g_hg) + weight * _draine(c, g_draine, alpha))[()]


def sample_mie_fit(u, droplet_diameter):
    """cos_theta of the droplet fit: u < w takes Draine's lobe, what is left of u samples it."""
    u, diameter = np.broadcast_arrays(_uniform(u), droplet_diameter)
    g_hg, g_draine, alpha, weight = mie_fit_parameters(diameter)
    second, u = _choose_lobe(u, weight)
    # Henyey-Greenstein is Draine's function with alpha = 0.
    return sample_draine(u, np.where(second, g_draine, g_hg), np.where(second, alpha, 0.0))


def mean_cosine_mie_fit(droplet_diameter):
    """Mean cosine of the droplet fit, (1 - w) g_hg + w mean_cosine_draine(g_draine, alpha)."""
    g_hg, g_draine, alpha, weight = mie_fit_parameters(droplet_diameter)
    return (1 - weight) * g_hg + weight * mean_cosine_draine(g_draine, alpha)


def _mie_fog_and_cloud(d):
    return (
        np.exp(-0.0990567 / (d - 1.67154)),
        np.exp(-2.20679 / (d + 3.91029) - 0.428934),
        np.exp(3.62489 - 8.29288 / (d + 5.52825)),
        np.exp(-0.599085 / (d - 0.641583) - 0.665888),
    )


def _mie_below_five(d):
    x = np.log(d)
    y = np.log(x)
    return (
        0.0604931 * y + 0.940256,
        0.500411 - 0.081287 / (-2 * x + np.tan(x) + 1.27551),
        7.30354 * x + 6.31675,
        0.026914 * (x - np.cos(5.68947 * (y - 0.0292149))) + 0.376475,
    )


def _mie_below_one_and_half(d):
    x = np.log(d)
    angle = (x - 0.238604) * (x + 1.00667) / (0.507522 - 0.15677 * x)
    return (
        0.862 - 0.143 * x * x,
        0.379685 * np.cos(1.19692 * np.cos(angle) + 1.37932 * x + 0.0625835) + 0.344213,
        250.0,
        0.146209 * np.cos(3.38707 * x + 2.11193) + 0.316072 + 0.0778917 * x,
    )


def _mie_below_tenth(d):
    return (
        13.8 * d * d,
        1.1456 * d * np.sin(9.29044 * d),
        250.0,
        0.252977 - 312.983 * d**4.3,
    )


# --- Fournier-Forand ---------------------------------------------------------
#
# With s = sin^2(theta/2), K = 4 / (3 (n-1)^2), delta = K s and the Junge slope
# mu of the particle sizes, the literature writes, for v = (3 - mu) / 2,
#
#   p = [ v (1-delta) - (1-delta^v) + (delta (1-delta^v) - v (1-delta)) / s ]
#       / (4 pi (1-delta)^2 delta^v)
#       + (1-K^v) / (16 pi (K-1) K^v) (3 c^2 - 1).
#
# The backscatter fraction fixes v, which then lies in (-1, 0). Below, a = -v,
# b = 1 + v and L = ln delta: every term becomes positive, and the double zero at
# delta = 1 cancels inside one entire function of L.

# Below exp(-40) of the whole circle the cosine is 1 to the last bit.
_LOG_SMALLEST_SHARE = -40.0


def fournier_forand(cos_theta, backscatter, ior):
    """Fournier-Forand scattering by ocean particles, per steradian.

    The formula stands in the comment above (1999 form); backscatter B in
    (0, 1/2) is the share scattered backward of 90 degrees and fixes the Junge
    slope by -v = ln(1 + 2 B (delta90 - 1)) / ln(delta90), delta90 = K / 2;
    ior in (1, 1000] is the particles' index relative to the medium. All broadcast.

    Positive everywhere. At cos_theta = 1 the formula has an integrable
    singularity, p ~ (1 - c)^(-1 - v), and the value there is infinity. Relative
    error below 1e-12 elsewhere.
    Source: Fournier and Jonasz, SPIE 3761 (1999); Mobley, Sundman and Boss,
    Applied Optics 41 (2002).
    """
    c, backscatter, ior = np.broadcast_arrays(
        checks.cosine("cos_theta", cos_theta), *_particles(backscatter, ior)
    )
    a, b, log_k = _fournier_forand_exponents(backscatter, ior)
    forward = c == 1
    s = np.where(forward, 1.0, (1 - c) / 2)
    value = _fournier_forand(s, c, a, b, log_k)
    return np.where(forward, np.inf, value)[()]


def sample_fournier_forand(u, backscatter, ior):
    """cos_theta of Fournier-Forand for u in [0, 1], backscatter and ior, broadcasting.

    The distribution function is known in closed form and is inverted in
    ln sin^2(theta/2) by Newton's method kept inside a bracket.
    """
    u, backscatter, ior = np.broadcast_arrays(_uniform(u), *_particles(backscatter, ior))
    a, b, log_k = _fournier_forand_exponents(backscatter, ior)

    log_s = _invert(
        _fournier_forand_share_within,
        _fournier_forand_log_density,
        1 - u,
        lower=_LOG_SMALLEST_SHARE,
        upper=0,
        start=_LOG_SMALLEST_SHARE / 2,
        parameters=(a, b, log_k),
        resolution=np.finfo(np.float64).eps,
    )
    return np.where(u == 0, -1.0, 1 - 2 * np.exp(log_s))[()]


def mean_cosine_fournier_forand(backscatter, ior):
    """Mean cosine of Fournier-Forand to 1e-12, backscatter and ior broadcasting.

    Integration by parts gives 2 * (integral of the distribution function over
    s = sin^2(theta/2)) - 1; in ln s the integrand is smooth and decays
    exponentially, so that Gauss-Legendre panels reach full precision.
    """
    backscatter, ior = np.broadcast_arrays(*_particles(backscatter, ior))
    a, b, log_k = (
        x[..., np.newaxis] for x in _fournier_forand_exponents(backscatter, ior)
    )
    panels = 14
    width = -_LOG_SMALLEST_SHARE / panels
    log_s = (-width * (np.arange(panels)[:, np.newaxis] + _NODES_16)).ravel()
    weights = width * np.tile(_WEIGHTS_16, panels)
    share = _fournier_forand_share_within(log_s, a, b, log_k)
    # Rounding of the sum must not exceed the cosine of a lobe that is all forward.
    return np.minimum(2 * np.sum(weights * np.exp(log_s) * share, axis=-1) - 1, 1.0)


def _fournier_forand(s, c, a, b, log_k):
    log_delta = log_k + np.log(s)
    peak = (1 + a) * _curvature(a, log_delta) + np.exp(log_k) * b * _curvature(-b, log_delta)
    correction = _power_ratio(a, log_k) * (3 * c * c - 1) / 4
    return _ISOTROPIC * (a * peak + correction)


def _fournier_forand_share_within(log_s, a, b, log_k):
    """Share scattered into the cone around the forward direction that s bounds."""
    log_delta = log_k + log_s
    s = np.exp(log_s)
    peak = np.exp(a * log_delta) * _power_ratio(b, log_delta) + s * _power_ratio(a, log_delta)
    odd = _power_ratio(a, log_k) * (1 - 2 * s) * s * (1 - s) / 2
    return peak + odd


def _fournier_forand_log_density(log_s, a, b, log_k):
    s = np.exp(log_s)
    return 4 * np.pi * s * _fournier_forand(s, 1 - 2 * s, a, b, log_k)


def _curvature(c, x):
    """(integral of (e^y - 1) e^(c y) over y in [0, x]) / (e^x - 1)^2; 1/2 at x = 0."""
    c, x = np.broadcast_arrays(c, x)
    near = np.abs(x) < 1
    far_x = np.where(near, 1.0, x)
    integral = _power_integral(c + 1, far_x) - _power_integral(c, far_x)
    ratio = np.array(integral / np.expm1(far_x) ** 2)
    ratio[near] = _curvature_near_zero(c[near], x[near])
    return ratio


def _curvature_near_zero(c, x):
    """_curvature for |x| < 1, summed from terms of one sign where the difference cancels."""
    x = np.where(x == 0, np.finfo(np.float64).tiny, x)[..., np.newaxis]
    y = x * _NODES_12
    mean = np.sum(_WEIGHTS_12 * np.expm1(y) / x * np.exp(c[..., np.newaxis] * y), axis=-1)
    return mean * (x / np.expm1(x))[..., 0] ** 2


def _power_integral(c, x):
    """Integral of e^(c y) over y in [0, x], (e^(c x) - 1) / c; x at c = 0."""
    flat = np.abs(c * x) < 1e-8
    divisor = np.where(flat, 1.0, c)
    return np.where(flat, x * (1 + c * x / 2), np.expm1(c * x) / divisor)


def _power_ratio(c, x):
    """(e^(c x) - 1) / (e^x - 1); c at x = 0."""
    level = x == 0
    return np.where(level, c, np.expm1(c * x) / np.expm1(np.where(level, 1.0, x)))


def _fournier_forand_exponents(backscatter, ior):
    """a = -v, b = 1 + v and ln K; both exponents keep their relative precision near 0."""
    log_k = np.log(4 / 3) - 2 * np.log(ior - 1)
    log_90 = log_k - np.log(2)
    level = log_90 == 0
    forward = 1 - 2 * backscatter
    excess = np.expm1(log_90)
    # 1 + 2 B (delta90 - 1) as a sum of positive terms: delta90 to the power a.
    power = forward + 2 * backscatter * np.exp(log_90)
    divisor = np.where(level, 1.0, log_90)
    a = _log_near_one(power, 2 * backscatter * excess) / divisor
    b = _log_near_one(np.exp(log_90) / power, forward * excess / power) / divisor
    return np.where(level, 2 * backscatter, a), np.where(level, forward, b), log_k


def _log_near_one(value, excess):
    """ln(value), by way of excess = value - 1 unless that is close to -1."""
    direct = excess < -0.5
    return np.where(direct, np.log(value), np.log1p(np.where(direct, 0.0, excess)))


def _particles(backscatter, ior):
    backscatter = checks.checked(
        "backscatter",
        backscatter,
        lambda x: (x > 0) & (x < 0.5),
        "in (0, 0.5)",
        "ocean particles have 0.0001 to 0.1; at 0.5 use isotropic",
    )
    ior = checks.checked(
        "ior",
        ior,
        lambda x: (x > 1) & (x <= 1000),
        "in (1, 1000], relative to the medium",
        "particles in water have 1.02 to 1.2",
    )
    return backscatter, ior


# --- shared ------------------------------------------------------------------


def _invert(distribution, density, target, lower, upper, start, parameters, resolution=0.0):
    """Solve distribution(x, *parameters) = target for x in [lower, upper], elementwise.

    Newton's method; a step that leaves the bracket is replaced by a bisection,
    so that it converges wherever the density vanishes or explodes. Elements
    leave the iteration as soon as they meet the target to rounding or their
    bracket has shrunk to neighbouring numbers, or to ``resolution``. Targets
    beyond the distribution's ends give the ends.
    """
    target, start, *parameters = np.broadcast_arrays(target, start, *parameters)
    shape = target.shape
    target, *parameters = (np.ravel(a) for a in (target, *parameters))
    x = np.array(start, dtype=np.float64).ravel()
    lower, upper = np.full(x.shape, float(lower)), np.full(x.shape, float(upper))
    below = target <= distribution(lower, *parameters)
    above = target >= distribution(upper, *parameters)
    x = np.where(below, lower, np.where(above, upper, x))
    active = np.flatnonzero(~(below | above))
    while active.size:
        here, chosen = x[active], [p[active] for p in parameters]
        residual = distribution(here, *chosen) - target[active]
        low = np.where(residual <= 0, here, lower[active])
        high = np.where(residual >= 0, here, upper[active])
        lower[active], upper[active] = low, high
        met = np.abs(residual) <= 2 * np.finfo(np.float64).eps * target[active]
        neighbours = 2 * np.spacing(np.maximum(np.abs(low), np.abs(high)))
        narrow = high - low <= np.maximum(neighbours, resolution)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            newton = here - residual / density(here, *chosen)
        inside = (newton > low) & (newton < high)
        following = np.where(inside, newton, low + (high - low) / 2)
        x[active] = np.where(met, here, following)
        active = active[~(met | narrow)]
    return x.reshape(shape)


def _uniform(u):
    return checks.fraction("u", u, "draw it from the unit interval")


def _asymmetry(name, g):
    return checks.checked(
        name,
        g,
        lambda x: np.abs(x) < 1,
        "in (-1, 1)",
        "at +-1 the lobe is a delta; stay below, such as at 0.999",
    )
