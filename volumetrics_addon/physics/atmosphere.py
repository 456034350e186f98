# SPDX-License-Identifier: GPL-3.0-or-later
"""Atmosphere of a spherical planet: scattering coefficients, optical depths, tables of multiple scattering.

Positions are given by ``radius``, the distance to the planet's centre (m); directions by ``mu``, the cosine between
the ray and the local zenith. Densities are exp(-(radius - planet_radius) / scale_height). Computation is float64,
scalar arguments broadcast. Functions raise ValueError for NaN and for arguments out of range.

``rayleigh_coefficient``, ``optical_depth`` and ``transmittance`` are exact; ``TransmittanceTable`` and
``ScatteringTables`` trade a stated error for speed. Source of the tables: Bruneton and Neyret, Precomputed atmospheric
scattering, EGSR 2008, and Bruneton's revision of 2017.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import checks
from .quadrature import gauss_legendre

# Scattering of air per Rec.709 channel, to be scaled: lambda^-4 at 657, 548 and 445 nm, normalised to luminance
# 0.2126 R + 0.7152 G + 0.0722 B = 1. Source: Akenine-Moeller et al., Real-Time Rendering, 4th ed. 2018, section 14.1.
RAYLEIGH_RGB = (0.490, 1.017, 2.339)

# Altitudes, in scale heights above the lowest point of a ray, between which one set of Gauss nodes serves; above the
# last one a share of exp(-36) = 2e-16 is left. 12 nodes then keep 1e-13 of the whole, see the tests.
_LEVELS = (0.0, 1.0, 4.0, 10.0, 20.0, 36.0)
_ORDER = 12
# Rays whose lowest point is nearer to the centre than a few scale heights bend upwards within a fraction of the first
# level; there these multiples of that radius are levels too.
_CENTRAL = (0.25, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0)
_CENTRAL_LIMIT = 2.0
_CLOSEST = 1e-30  # scale heights from the centre that count as through it
_FLATTEST = 1e12
_BLOCK = 1 << 14  # rays at a time, so that temporaries stay in the cache


def rayleigh_coefficient(wavelength, refractive_index=1.00029, number_density=2.504e25, king_factor=1.0):
    """Scattering coefficient of a gas, 8 pi^3 (n^2 - 1)^2 / (3 N lambda^4) F, per metre.

    wavelength > 0 in metres; refractive_index n >= 1; number_density N > 0 molecules per cubic metre; king_factor F >= 1
    corrects for anisotropic molecules: 1.0 reproduces 5.19673e-6, 1.21427e-5 and 2.96453e-5 at 680, 550 and 440 nm,
    about 1.05 is air's. Source: Lord Rayleigh 1899; King 1923.
    """
    wavelength = checks.positive("wavelength", wavelength, "metres", "550 nm is 550e-9")
    index = checks.checked(
        "refractive_index", refractive_index, lambda n: (n >= 1) & (n < np.inf), "finite and >= 1", "air has 1.00029")
    density = checks.positive("number_density", number_density, "molecules per m^3", "air has 2.504e25")
    king = checks.checked("king_factor", king_factor, lambda f: (f >= 1) & (f < np.inf), "finite and >= 1", "air has 1.05")
    refraction = (index - 1) * (index + 1)
    with np.errstate(over="ignore", under="ignore"):
        value = 8 * np.pi**3 / 3 * king * (refraction / wavelength / wavelength) ** 2 / density
    return checks.finite("coefficient", value, "per metre", "use a longer wavelength or a denser gas")[()]


# --- optical depth ------------------------------------------------------------------------------------------


def optical_depth(radius, mu, distance, sigma_0, scale_height, planet_radius):
    """Optical depth of the extinction sigma_0 exp(-(r - planet_radius) / scale_height) along a ray.

    Integral over t in [0, distance] at r(t) = sqrt(radius^2 + 2 radius mu t + t^2). The density goes on growing below
    planet_radius, as the formula says: end rays at the ground with ``ground_distance``. A depth beyond the range of
    float64, deep underground, is infinity.

    radius >= 0 and planet_radius > 0 metres; mu in [-1, 1]; distance >= 0, may be infinite; sigma_0 >= 0 per metre;
    scale_height > 0 metres. All broadcast. Relative error below 1e-12 + 1e-15 radius / scale_height, the latter being
    the sensitivity to the last digit of the arguments themselves.

    Method: the ray is cut at its lowest point and each half followed upwards in v = t + r(t), in which the altitude
    gained is v's increment w times (w + 2 r mu) / (2 v), free of cancellation, and which is smooth for grazing as for
    vertical rays; Gauss-Legendre between fixed altitudes then converges for all of them.
    """
    radius = checks.nonnegative("radius", radius, "metres", "measure from the planet's centre")
    mu = checks.cosine("mu", mu)
    distance = checks.nonnegative_or_infinite("distance", distance, "metres", "measure along the ray from its start")
    sigma_0 = checks.nonnegative("sigma_0", sigma_0, "per metre", "use a positive extinction")
    scale_height = checks.positive("scale_height", scale_height, "metres", "use such as 8000")
    planet_radius = checks.positive("planet_radius", planet_radius, "metres", "the Earth has 6.36e6")
    with np.errstate(over="ignore", under="ignore"):
        rho = checks.checked(
            "radius / scale_height", radius / scale_height, lambda x: x <= _FLATTEST, f"at most {_FLATTEST:g}",
            "so flat an atmosphere is physics.transmittance.height_optical_depth's")
        delta = distance / scale_height
    arrays = np.broadcast_arrays(rho, mu, delta, (radius - planet_radius) / scale_height, sigma_0, scale_height)
    shape = arrays[0].shape
    arrays = [a.ravel() for a in arrays]
    depth = np.empty(arrays[0].shape)
    for start in range(0, depth.size, _BLOCK):
        rho, mu, delta, altitude, sigma_0, scale_height = (a[start : start + _BLOCK] for a in arrays)
        with np.errstate(over="ignore", under="ignore", divide="ignore"):
            # One exponential of a sum, in which an enormous density and a tiny path do not overflow.
            log_depth = _log_density_path(rho, mu, delta, altitude) + np.log(scale_height) + np.log(sigma_0)
            depth[start : start + _BLOCK] = np.exp(log_depth)
    return depth.reshape(shape)[()]


def transmittance(radius, mu, distance, sigma_0, scale_height, planet_radius):
    """Transmittance exp(-optical_depth(...)); same arguments."""
    with np.errstate(under="ignore"):
        return np.exp(-optical_depth(radius, mu, distance, sigma_0, scale_height, planet_radius))


def ground_distance(radius, mu, planet_radius):
    """Distance (m) at which a ray from ``radius`` >= planet_radius meets the ground, infinity where it passes.

    A start within 1e-9 of planet_radius below it counts as on the ground. All broadcast.
    """
    planet_radius = checks.positive("planet_radius", planet_radius, "metres", "the Earth has 6.36e6")
    radius = _above("radius", checks.positive("radius", radius, "metres", "measure from the planet's centre"), planet_radius)
    mu = checks.cosine("mu", mu)
    # In units of the radius, whose square may leave the range of float64.
    height = (radius - planet_radius) / radius * ((radius + planet_radius) / radius)
    below = mu * mu - height
    hits = (mu < 0) & (below >= 0)
    root = np.sqrt(np.where(hits, below, 0.0))
    return np.where(hits, radius * (height / np.where(hits, root - mu, 1.0)), np.inf)[()]


def top_distance(radius, mu, top_radius):
    """Distance (m) at which a ray from ``radius`` <= top_radius leaves the sphere of top_radius. All broadcast."""
    top_radius = checks.positive("top_radius", top_radius, "metres", "measure from the planet's centre")
    radius = -_above("-radius", -checks.positive("radius", radius, "metres", "measure from the planet's centre"), -top_radius)
    mu = checks.cosine("mu", mu)
    # In units of the top's radius, whose square may leave the range of float64.
    along = radius / top_radius * mu
    depth = (top_radius - radius) / top_radius * ((top_radius + radius) / top_radius)
    root = np.sqrt(along * along + depth)
    upward = along > 0
    return (top_radius * np.where(upward, depth / np.where(upward, root + along, 1.0), root - along))[()]


def _radius(radius):
    return checks.positive("radius", radius, "metres", "measure from the planet's centre")


def _above(name, radius, limit):
    """``radius`` as float64, raised to ``limit`` where rounding left it below."""
    radius = checks.finite(name, radius, "metres")
    checks.checked(name + " - limit", radius - limit, lambda x: x >= -1e-9 * np.abs(limit), ">= 0 metres",
                   "start the ray between the ground and the top of the atmosphere")
    return np.maximum(radius, limit)


def _log_density_path(rho, mu, delta, altitude):
    """ln of the integral of exp(-(altitude gained since the start) - altitude), all lengths (n,) in scale heights."""
    rho = np.maximum(rho, _CLOSEST)
    down = mu < 0
    foot = np.where(down, -rho * mu, 0.0)
    sine = np.sqrt((1 - mu) * (1 + mu))
    before = down & (delta <= foot)
    short = np.where(before, delta, 0.0)
    end = np.maximum(np.hypot(rho * sine, short - foot), _CLOSEST)
    low_rho = np.where(before, end, np.where(down, np.maximum(rho * sine, _CLOSEST), rho))
    low_mu = np.where(before, np.minimum((foot - short) / end, 1.0), np.where(down, 0.0, mu))
    drop = np.where(before, short * (short - 2 * foot) / (end + rho), np.where(down, -rho * mu * mu / (1 + sine), 0.0))
    path = _rising_path(low_rho, low_mu, np.where(down & ~before, foot, delta))
    beyond = np.flatnonzero(down & ~before & (delta > foot))
    path[beyond] += _rising_path(low_rho[beyond], np.zeros(len(beyond)), delta[beyond] - foot[beyond])
    return np.log(path) - (altitude + drop)


def _rising_path(rho, mu, delta):
    """Integral of exp(-(r(t) - rho)) over [0, delta] for rays (n,) with mu >= 0, all lengths in scale heights."""
    path = np.zeros(len(rho))
    central = rho < _CENTRAL_LIMIT
    for rows in (np.flatnonzero(~central), np.flatnonzero(central)):
        if not len(rows):
            continue
        r, m = rho[rows], mu[rows]
        t, _ = _reach(r, m, _LEVELS[-1])
        t = np.minimum(t, delta[rows])
        gain = t * (2 * r * m + t) / (np.sqrt(r * r + t * (2 * r * m + t)) + r)
        end = t + gain
        levels = [np.full(len(r), level) for level in _LEVELS]
        if central[rows[0]]:
            levels = np.sort(np.stack(levels + [np.minimum(k * r, _LEVELS[1]) for k in _CENTRAL]), axis=0)
        edges = [np.minimum(sum(_reach(r, m, level)), end) for level in levels[:-1]] + [end]
        for low, high in zip(edges, edges[1:]):
            some = np.flatnonzero(low < high)
            if len(some):
                path[rows[some]] += _panel(r[some], m[some], low[some], high[some])
    return path


def _reach(rho, mu, level):
    """Distance t at which a rising ray has gained ``level``, and the level."""
    square = level * (2 * rho + level)
    root = rho * mu + np.sqrt((rho * mu) ** 2 + square)
    return square / np.where(root > 0, root, 1.0), level


def _panel(rho, mu, low, high):
    """Gauss-Legendre (n,) over w = v - v(0) in [low, high]; dt = (1 + p^2 / v^2) / 2 dw, p the distance from the centre."""
    nodes, weights = gauss_legendre(_ORDER, 0.0, 1.0)
    width = high - low
    w = low + nodes[:, None] * width
    v = w + rho * (1 + mu)
    gain = w * (w + 2 * rho * mu) / (2 * v)
    ratio = rho * np.sqrt((1 - mu) * (1 + mu)) / v
    return width * (weights @ (np.exp(-gain) * (0.5 + 0.5 * ratio * ratio)))


# --- planet -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Component:
    """Scattering and absorption (1/m, per channel) at the ground, scale height (m) and phase function of cos_theta."""

    sigma_s: tuple[float, float, float]
    sigma_a: tuple[float, float, float]
    scale_height: float
    phase: Callable


@dataclass(frozen=True)
class Planet:
    """Lambertian ground of ``radius`` under components that end at ``top``, both metres from the centre."""

    radius: float
    top: float
    components: tuple[Component, ...]
    albedo: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self):
        checks.positive("radius", self.radius, "metres", "the Earth has 6.36e6")
        checks.positive("top - radius", self.top - self.radius, "metres", "let the atmosphere end above the ground")
        checks.fraction("albedo", self.albedo)
        if not self.components:
            raise ValueError("components must hold at least one Component, got none; a planet without air needs no table")

    @cached_property
    def scattering(self):
        """sigma_s (components, 3) at the ground, 1/m."""
        return np.array([c.sigma_s for c in self.components], dtype=np.float64)

    @cached_property
    def extinction(self):
        """sigma_t (components, 3) at the ground, 1/m."""
        return self.scattering + np.array([c.sigma_a for c in self.components], dtype=np.float64)

    def density(self, radius):
        """Densities (..., components), 1 at the ground; raises ValueError for a radius that is not positive."""
        radius = _radius(radius)
        scale = np.array([c.scale_height for c in self.components])
        return np.exp((self.radius - radius[..., None]) / scale)

    def phases(self, cos_theta):
        """Phase functions (..., components), per steradian."""
        return np.stack([c.phase(cos_theta) for c in self.components], axis=-1)

    def paths(self, radius, mu, distance):
        """Integrals (..., components) of the densities along rays, in metres."""
        return np.stack([optical_depth(radius, mu, distance, 1.0, c.scale_height, self.radius)
                         for c in self.components], axis=-1)

    def transmittance(self, radius, mu, distance):
        """Transmittance (..., 3) of all components along rays within the atmosphere."""
        return self.attenuation(self.paths(radius, mu, distance))

    def attenuation(self, paths):
        """Transmittance (..., 3) of density integrals (..., components)."""
        paths = checks.nonnegative_or_infinite("paths", paths, "metres", "integrate the density along the ray")
        with np.errstate(over="ignore", under="ignore"):
            # A density integral that overflowed, deep underground, times an extinction of 0.
            return np.exp(-(np.minimum(paths, 1e300) @ self.extinction))

    def horizon(self, radius):
        """Cosine below which rays from ``radius`` meet the ground."""
        radius = np.maximum(_radius(radius), self.radius)
        return -np.sqrt((radius - self.radius) * (radius + self.radius)) / radius

    def sunlight(self, radius, mu_s):
        """Share (..., 3) of the sun's light that arrives at ``radius`` with the sun at zenith cosine mu_s, 0 in shadow."""
        radius, mu_s = np.broadcast_arrays(np.maximum(_radius(radius), self.radius), checks.cosine("mu_s", mu_s))
        lit = mu_s >= self.horizon(radius)
        toward = np.where(lit, mu_s, 1.0)
        clear = self.transmittance(radius, toward, top_distance(radius, toward, self.top))
        return np.where(lit[..., None], clear, 0.0)


def ray_nodes(planet, radius, mu, low, high, order):
    """Gauss-Legendre positions and weights (..., order) over [low, high] of rays from ``radius``, all (...).

    In y = asinh((t - lowest point) / c), where c is the way on which the ray gains the least scale height: dense where
    the air is, whether the ray rises, descends to the ground, or grazes.
    """
    radius, mu, low, high = (np.asarray(x, dtype=np.float64) for x in (radius, mu, low, high))
    nodes, weights = gauss_legendre(order, 0.0, 1.0)
    height = min(c.scale_height for c in planet.components)
    passing = radius * np.sqrt((1 - mu) * (1 + mu))
    hits = (mu < 0) & (passing < planet.radius)
    slope = np.sqrt(np.maximum((planet.radius - passing) * (planet.radius + passing), 0.0))
    foot = np.where(mu < 0, -radius * mu - np.where(hits, slope, 0.0), 0.0)
    lowest = np.where(hits, planet.radius, np.where(mu < 0, passing, radius))
    rising = np.where(hits, slope / planet.radius, np.maximum(mu, 0.0))
    scale = height * _reach(lowest / height, rising, 1.0)[0]
    start = np.arcsinh((low - foot) / scale)
    width = np.arcsinh((high - foot) / scale) - start
    y = start[..., None] + width[..., None] * nodes
    t = foot[..., None] + scale[..., None] * np.sinh(y)
    return np.clip(t, low[..., None], high[..., None]), (width * scale)[..., None] * weights * np.cosh(y)


# --- tables -------------------------------------------------------------------------------------------------


class TransmittanceTable:
    """Transmittance from (radius, mu) to the top of the atmosphere, bilinear in the density integrals.

    Nodes on Bruneton's mapping: radius by the distance to the horizon, mu by the distance to the top, both relative to
    their ranges. ``table(radius, mu)`` gives (..., 3), 0 for rays that meet the ground. ``interpolation_error()`` is the
    largest absolute error, measured halfway between the nodes. Sizes >= 2.
    """

    def __init__(self, planet, radii=32, cosines=128):
        if min(radii, cosines) < 2:
            raise ValueError(f"radii and cosines must be >= 2, got {radii} and {cosines}; 32 and 128 are usual")
        self.planet = planet
        self._shape = (radii, cosines)
        self._reach = np.sqrt((planet.top - planet.radius) * (planet.top + planet.radius))
        radius, mu = self._arguments(*np.meshgrid(np.linspace(0, 1, radii), np.linspace(0, 1, cosines), indexing="ij"))
        self._paths = planet.paths(radius, mu, top_distance(radius, mu, planet.top))

    def _arguments(self, x, y):
        """radius and mu at the coordinates x and y in [0, 1]."""
        rho = x * self._reach
        radius = np.minimum(np.hypot(rho, self.planet.radius), self.planet.top)
        nearest = self.planet.top - radius
        distance = nearest + y * (rho + self._reach - nearest)
        away = distance > 0
        mu = (self._reach**2 - rho**2 - distance**2) / np.where(away, 2 * radius * distance, 1.0)
        return radius, np.clip(np.where(away, mu, 1.0), self.planet.horizon(radius), 1.0)

    def __call__(self, radius, mu):
        radius, mu = np.broadcast_arrays(_radius(radius), checks.cosine("mu", mu))
        radius = np.clip(radius, self.planet.radius, self.planet.top)
        rho = np.sqrt((radius - self.planet.radius) * (radius + self.planet.radius))
        nearest = self.planet.top - radius
        distance = top_distance(radius, mu, self.planet.top)
        y = (distance - nearest) / np.maximum(rho + self._reach - nearest, 1e-300)
        coordinates = (rho / self._reach * (self._shape[0] - 1), y * (self._shape[1] - 1))
        above = mu >= self.planet.horizon(radius)
        return np.where(above[..., None], self.planet.attenuation(interpolated(self._paths, coordinates)), 0.0)

    def interpolation_error(self):
        """Largest absolute error of the transmittance, measured at the centres of the cells between the nodes."""
        centres = np.meshgrid(*((np.arange(n - 1) + 0.5) / (n - 1) for n in self._shape), indexing="ij")
        radius, mu = self._arguments(*centres)
        exact = self.planet.transmittance(radius, mu, top_distance(radius, mu, self.planet.top))
        return float(np.abs(self(radius, mu) - exact).max())


def transmittance_table(planet, radii=32, cosines=128):
    """The TransmittanceTable of a planet."""
    return TransmittanceTable(planet, radii, cosines)


def interpolated(table, coordinates):
    """Multilinear interpolation (..., *rest) of ``table`` at fractional node indices, one array (...) per axis, clamped."""
    shape = coordinates[0].shape
    axes = table.shape[: len(coordinates)]
    flat = table.reshape(int(np.prod(axes)), -1)
    index, weight = np.zeros((1, coordinates[0].size), np.int64), np.ones((1, coordinates[0].size))
    for coordinate, n in zip(coordinates, axes):
        x = np.clip(coordinate.ravel(), 0, n - 1)
        low = np.minimum(x.astype(np.int64), n - 2)
        high = x - low
        index = np.concatenate([index * n + low, index * n + low + 1])
        weight = np.concatenate([weight * (1 - high), weight * high])
    value = weight[0][:, None] * flat[index[0]]
    for i, w in zip(index[1:], weight[1:]):
        value += w[:, None] * flat[i]
    return value.reshape(shape + table.shape[len(coordinates) :])


class ScatteringTables:
    """Orders of scattering of parallel light of unit irradiance in a planet's atmosphere, by iterated tables.

    For each component the table holds the integral of its phase function times the radiance of orders 1 to
    ``orders`` - 1, which times sigma_s and density is the source of orders 2 to ``orders``. Its axes are altitude (its
    square root), the sun's zenith cosine (its square root, dense around the horizon), zenith angle and azimuth from the
    sun; ``size`` scales them all. The symmetry about the sun's plane halves the azimuth. Each iteration integrates the
    sources along all rays (``order`` nodes each, the ground behind them) and the radiance over all directions, with
    weights that keep a uniform field uniform. Events on the ground count as orders.

    ``change`` is the mean source of the last order over that of the one before: the ratio at which a cut series goes on.
    """

    def __init__(self, planet, orders, size=12, order=16, transmittance=None):
        if orders < 1 or size < 4:
            raise ValueError(f"orders must be >= 1 and size >= 4, got {orders} and {size}; 4 and 12 are usual")
        self.planet, self.orders = planet, orders
        self.transmittance = transmittance or TransmittanceTable(planet)
        radii, suns, azimuths = size, 2 * size, max(4, size // 2)
        self._radius = planet.radius + (planet.top - planet.radius) * np.linspace(0, 1, radii) ** 2
        # Beyond this no order that matters is left, even at the top.
        self._first_sun = -np.sqrt(min(1.0, -2.5 * planet.horizon(planet.top)))
        sun = np.linspace(self._first_sun, 1, suns)
        self._sun = sun * np.abs(sun)
        self._shape = (radii, suns, size + 1, azimuths + 1)
        self._source = np.zeros((*self._shape, len(planet.components), 3))
        self._diffuse = [np.zeros((suns, 3))]
        self.change = 0.0
        if orders == 1:
            return
        rays = [self._rays(radius, size, azimuths, order) for radius in self._radius]
        previous, source = 0.0, None
        for n in range(1, orders):
            source = self._iterate(rays, source)
            self._source += source
            total = float(source.mean())
            self.change = total / previous if previous > 0 else 0.0
            previous = total

    def _rays(self, radius, size, azimuths, order):
        """Everything about the rays from one radius that the orders have in common."""
        planet = self.planet
        horizon = planet.horizon(radius)
        up, up_weight = gauss_legendre(size, 0.0, 1.0)
        down, down_weight = gauss_legendre(size // 2 + 2, 0.0, 1.0)
        # Squared: the radiance is steep on both sides of the horizon.
        mu = np.concatenate([horizon + (1 - horizon) * up**2, horizon - (1 + horizon) * down**2])
        share = np.concatenate([2 * up * (1 - horizon) * up_weight, 2 * down * (1 + horizon) * down_weight])
        azimuth = (np.arange(azimuths) + 0.5) * np.pi / azimuths
        ground = np.where(np.arange(len(mu)) < size, np.inf, ground_distance(radius, np.minimum(mu, horizon), planet.radius))
        end = np.minimum(ground, top_distance(radius, mu, planet.top))
        rows = np.full(mu.shape, radius)
        t, weight = ray_nodes(planet, rows, mu, np.zeros_like(mu), end, order)
        there = np.clip(np.sqrt(radius**2 + t * (2 * radius * mu[:, None] + t)), planet.radius, planet.top)
        strength = weight[..., None, None] * planet.density(there)[..., None] * planet.scattering
        strength *= planet.transmittance(rows[:, None], mu[:, None], t)[..., None, :]
        hits = np.flatnonzero(np.isfinite(ground))
        reflected = np.array(planet.albedo) / np.pi * planet.transmittance(rows[hits], mu[hits], ground[hits])
        nu = _cosine(mu[None, :, None], self._sun[:, None, None], np.cos(azimuth))
        mu_s = (radius * self._sun[:, None, None, None] + t[:, None, :] * nu[..., None]) / there[:, None, :]
        mu_s = np.clip(mu_s, -1, 1)
        below = np.clip((radius * self._sun[:, None, None] + ground[hits, None] * nu[:, hits]) / planet.radius, -1, 1)
        slope = (radius * mu[:, None] + t) / there
        weights = np.stack([self._phase_weights(c.phase, mu, share, azimuth) for c in planet.components])
        return {"mu": mu, "share": share, "there": there, "slope": np.clip(slope, -1, 1), "strength": strength, "hits": hits,
                "reflected": reflected, "nu": nu, "mu_s": mu_s, "below": below, "weights": weights,
                "width": 2 * np.pi / azimuths}

    def _phase_weights(self, phase, mu, share, azimuth):
        """Weights (outgoing directions, incoming directions) of sum 1 per outgoing direction."""
        polar = np.cos(np.linspace(0, np.pi, self._shape[2]))
        turn = np.linspace(0, np.pi, self._shape[3])
        within = ((np.arange(4) + 0.5) / 4 - 0.5) * (azimuth[1] - azimuth[0])
        turns = np.concatenate([within, -within])[:, None] + azimuth
        difference = np.cos(turn[:, None, None] - turns * np.repeat([1, -1], 4)[:, None])
        cosine = _cosine(polar[:, None, None, None, None], mu[:, None], difference[None, :, :, None, :])
        weights = phase(cosine).mean(axis=2) * share[:, None]
        weights = weights.reshape(len(polar) * len(turn), -1)
        return weights / weights.sum(axis=1, keepdims=True)

    def _iterate(self, rays, source):
        """From the sources of one order (None: the sun) the next order's, and its irradiance on the ground."""
        result = np.empty(self._source.shape)
        for i, ray in enumerate(rays):
            if source is None:
                sun = self.transmittance(ray["there"][None, :, None, :], ray["mu_s"])
                direct = np.einsum("kqcx,skpqx->skpcx", ray["strength"], sun)
                radiance = np.einsum("skpcx,skpc->skpx", direct, self.planet.phases(ray["nu"]))
            else:
                radiance = np.empty((*ray["nu"].shape, 3))
                for j in range(len(self._sun)):  # one at a time, to bound the memory
                    arrived = self._lookup(source, ray["there"][:, None, :], ray["slope"][:, None, :], ray["mu_s"][j],
                                           ray["nu"][j][..., None])
                    radiance[j] = np.einsum("kqcx,kpqcx->kpx", ray["strength"], arrived)
            lit = self._direct(ray["below"]) if source is None else self._scattered(self._diffuse[-1], ray["below"])
            radiance[:, ray["hits"]] += ray["reflected"][:, None, :] * lit
            flat = radiance.reshape(len(self._sun), -1, 3)
            result[i] = np.einsum("col,slx->socx", ray["weights"], flat, optimize=True).reshape(result[i].shape)
            if i == 0:
                falling = np.maximum(ray["mu"], 0.0) * ray["share"] * ray["width"]
                diffuse = np.einsum("k,skpx->sx", falling, radiance)
        self._diffuse.append(diffuse)
        return result

    def _direct(self, mu_s):
        return np.maximum(mu_s, 0.0)[..., None] * self.transmittance(self.planet.radius, mu_s)

    def _scattered(self, diffuse, mu_s):
        return interpolated(diffuse, (self._sun_index(mu_s),))

    def _sun_index(self, mu_s):
        return (np.sign(mu_s) * np.sqrt(np.abs(mu_s)) - self._first_sun) / (1 - self._first_sun) * (self._shape[1] - 1)

    def _lookup(self, source, radius, mu, mu_s, nu):
        radius, mu, mu_s, nu = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (radius, mu, mu_s, nu)))
        across = np.sqrt((1 - mu) * (1 + mu) * (1 - mu_s) * (1 + mu_s))
        azimuth = np.clip((nu - mu * mu_s) / np.maximum(across, 1e-9), -1, 1)
        altitude = np.clip((radius - self.planet.radius) / (self.planet.top - self.planet.radius), 0, 1)
        radii, _, polars, azimuths = self._shape
        return interpolated(source, (np.sqrt(altitude) * (radii - 1), self._sun_index(mu_s),
                                     np.arccos(mu) / np.pi * (polars - 1), np.arccos(azimuth) / np.pi * (azimuths - 1)))

    def source(self, radius, mu, mu_s, nu):
        """Source (..., 3) of orders 2 to ``orders`` per metre of path, for unit irradiance.

        mu and mu_s: zenith cosines of the ray and of the sun; nu: the cosine between them. All broadcast, in range.
        """
        radius = _radius(radius)
        mu, mu_s, nu = (checks.cosine(name, x) for name, x in (("mu", mu), ("mu_s", mu_s), ("nu", nu)))
        value = self._lookup(self._source, radius, mu, mu_s, nu)
        return np.einsum("...c,cx,...cx->...x", self.planet.density(radius), self.planet.scattering, value)

    def irradiance(self, mu_s):
        """Irradiance (..., 3) on the ground in orders 0 to ``orders`` - 1, for unit irradiance of the sun."""
        mu_s = checks.cosine("mu_s", mu_s)
        return self._direct(mu_s) + self._scattered(np.sum(self._diffuse, axis=0), mu_s)


def scattering_tables(planet, orders, size=12):
    """The ScatteringTables of a planet. Each order of size 8, 12 and 16 takes a quarter, one and three seconds."""
    return ScatteringTables(planet, orders, size)


def _cosine(mu, other, turn):
    """Cosine between directions of zenith cosines mu and other whose azimuths differ by an angle of cosine ``turn``."""
    across = np.sqrt((1 - mu) * (1 + mu)) * np.sqrt((1 - other) * (1 + other))
    return np.clip(mu * other + across * turn, -1, 1)


class UniformScattering:
    """All higher orders as if they were isotropic and lit from all around alike: one value per (radius, mu_s).

    Psi = L_2 (1 + f + f^2 + ... ), up to ``orders``, where L_2 is the mean over directions of the light scattered once
    (isotropically) or reflected by the ground, and f that of a uniform field. ``uniform(radius, mu_s)`` gives (..., 3)
    for unit irradiance; sigma_s times it is the source; ``irradiance(mu_s)`` is what that sky sends down to the ground.
    Source: Hillaire, A scalable and production ready sky and
    atmosphere rendering technique, EGSR 2020, section 5.5.
    """

    def __init__(self, planet, orders, transmittance, size=16, order=12):
        self._planet, self._size = planet, size
        self._altitude = np.linspace(0, 1, size)
        radius = planet.radius + (planet.top - planet.radius) * self._altitude**2
        sun = np.linspace(-1, 1, 2 * size)
        sun = sun * np.abs(sun)
        x, x_weight = gauss_legendre(8, 0.0, 1.0)
        turn = (np.arange(6) + 0.5) * np.pi / 6
        value, earlier = np.zeros((2, size, len(sun), 3))
        for i, r in reversed(list(enumerate(radius))):
            horizon = planet.horizon(r)
            mu = np.concatenate([horizon + (1 - horizon) * x**2, horizon - (1 + horizon) * x**2])
            share = np.concatenate([x * (1 - horizon) * x_weight, x * (1 + horizon) * x_weight])
            ground = np.where(mu < horizon, ground_distance(r, mu, planet.radius), np.inf)
            hits = np.isfinite(ground)
            end = np.minimum(ground, top_distance(r, mu, planet.top))
            t, weight = ray_nodes(planet, np.full(mu.shape, r), mu, np.zeros_like(mu), end, order)
            there = np.clip(np.sqrt(r**2 + t * (2 * r * mu[:, None] + t)), planet.radius, planet.top)
            strength = weight[..., None] * (planet.density(there) @ planet.scattering)
            strength *= planet.transmittance(r, mu[:, None], t)
            again = np.einsum("k,kqx->x", share, strength)
            nu = _cosine(mu[None, :, None], sun[:, None, None], np.cos(turn))
            mu_s = np.clip((r * sun[:, None, None, None] + t[:, None, :] * nu[..., None]) / there[:, None, :], -1, 1)
            lit = transmittance(there[None, :, None, :], mu_s)
            arrived = np.einsum("kqx,skpqx->skx", strength, lit, optimize=True) / len(turn)
            once = np.einsum("k,skx->sx", share / (4 * np.pi), arrived)
            below = np.clip((r * sun[:, None, None] + np.where(hits, ground, 0.0)[:, None] * nu) / planet.radius, -1, 1)
            reflected = np.maximum(below, 0.0)[..., None] * transmittance(planet.radius, below)
            back = hits[:, None] * np.array(planet.albedo) / np.pi * planet.transmittance(r, mu, np.where(hits, ground, 0.0))
            once += np.einsum("k,kx,skpx->sx", share, back, reflected) / len(turn)
            value[i] = once * sum(again**n for n in range(orders - 1))
            earlier[i] = once * sum(again**n for n in range(orders - 2))
        self._value = value
        # The last rays were the ground's. Light that the ground scatters in the last order was scattered once less before.
        uniform = self._lookup(earlier, there[:, None, :], mu_s)
        arrived += np.einsum("kqx,skpqx->skx", strength, uniform, optimize=True) * (4 * np.pi / len(turn))
        self._irradiance = np.einsum("k,skx->sx", share * np.maximum(mu, 0.0), arrived)

    def __call__(self, radius, mu_s):
        return self._lookup(self._value, _radius(radius), checks.cosine("mu_s", mu_s))

    def irradiance(self, mu_s):
        """Irradiance (..., 3) of the sky on the ground, for unit irradiance of the sun."""
        return interpolated(self._irradiance, (self._sun_index(checks.cosine("mu_s", mu_s)),))

    def _lookup(self, value, radius, mu_s):
        radius, mu_s = np.asarray(radius, dtype=np.float64), np.asarray(mu_s, dtype=np.float64)
        altitude = np.clip((radius - self._planet.radius) / (self._planet.top - self._planet.radius), 0, 1)
        coordinates = np.broadcast_arrays(np.sqrt(altitude) * (self._size - 1), self._sun_index(mu_s))
        return interpolated(value, tuple(coordinates))

    def _sun_index(self, mu_s):
        return (np.sign(mu_s) * np.sqrt(np.abs(mu_s)) + 1) / 2 * (2 * self._size - 1)
