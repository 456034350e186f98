# SPDX-License-Identifier: GPL-3.0-or-later
"""The densities of NoiseShape and Dust, with the fractal Perlin noise and the cells that Blender's texture nodes evaluate.

Perlin: gradient noise (Improving Noise, 2002) on an integer lattice hashed with the final mix of Jenkins' lookup3 (public
domain, 2006); fractal sum with lacunarity 2, normalised to [0, 1]. Cells: the distance to the nearest of one random point a
cell (Worley, A Cellular Texture Basis Function, 1996), from Blender 5 on hashed with PCG3D (Jarzynski and Olano, Hash
Functions for GPU Rendering, 2020) in signed integers, before with lookup3 over the bits of the cell's coordinates. The same arithmetic runs on NumPy arrays and, where numba is installed, compiled.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .model import CELL_HASHES, PROFILES, Dust, NoiseShape

_MASK = 0xFFFFFFFF
_SEED = (0xDEADBEEF + (3 << 2) + 13) & _MASK
_SCALE = 0.9820  # Blender's factor that brings 3D Perlin noise to about [-1, 1]
SEED_STEP = (13.25, 78.5, 37.75)  # quarters: exact in the float32 of the engines for every seed
SEED_PERIOD = 100.0
DUST_DETAIL, DUST_ROUGHNESS = 2.0, 0.5
BILLOW_MEAN = 0.37  # about the mean of the squared distance to the nearest point: billows neither swell nor shrink a body
# How far a step of evolution lifts the two kinds of noise through one another, in their own sizes.
EVOLUTION_RISE, BILLOW_RISE = 1.0, 2.5
# Shares of the domain that the two parts of an anvil fill: width of the column, height and thickness of the anvil.
COLUMN_WIDTH, ANVIL_HEIGHT, ANVIL_THICKNESS = 0.6, 0.8, 0.2


def seed_offset(seed: int) -> np.ndarray:
    """Shift (3,) of the noise coordinates for a seed: seed times a step, modulo a period."""
    return np.mod(seed * np.array(SEED_STEP), SEED_PERIOD)


def numbers(shape: NoiseShape) -> tuple[float, ...]:
    """The shape as the row of numbers that the compiled functions read."""
    return (*shape.center, *shape.half, shape.noise_size, *seed_offset(shape.seed), shape.detail, shape.roughness,
            shape.noise_strength, shape.fill, shape.softness, PROFILES.index(shape.profile), shape.stretch, *shape.drift,
            shape.evolution, shape.billow_size, shape.billow_strength, shape.billow_octaves, shape.billow_roughness,
            shape.base, CELL_HASHES.index(shape.cell_hash))


def dust_numbers(dust: Dust) -> tuple[float, ...]:
    """The dust as the row of numbers that the compiled functions read."""
    return dust.size, *(seed_offset(dust.seed) - np.array(dust.drift) / dust.size), dust.strength


def dust_density(dust: Dust, position: np.ndarray) -> np.ndarray:
    """Density (n,) >= 0 at positions (n, 3); see Dust for the formula."""
    x, y, z = (np.asarray(position, float) / dust.size + dust_numbers(dust)[1:4]).T
    return np.maximum(0.0, 1.0 + dust.strength * (2.0 * fractal_noise(x, y, z, DUST_DETAIL, DUST_ROUGHNESS) - 1.0))


def density(shape: NoiseShape, position: np.ndarray) -> np.ndarray:
    """Density (n,) in [0, 1] at positions (n, 3); see NoiseShape for the formula."""
    return _evaluator()[2](np.array(numbers(shape), float), np.ascontiguousarray(position, float))


def margin(shape: NoiseShape, position: np.ndarray) -> np.ndarray:
    """What becomes the density (n,) at positions (n, 3) when it is clamped to [0, 1]: below 0 the air is clear."""
    return _evaluator()[1](np.array(numbers(shape), float), np.ascontiguousarray(position, float))


def fractal_noise(x, y, z, detail: float, roughness: float) -> np.ndarray:
    """Normalised fractal Perlin noise in about [0, 1] at coordinates of one shape.

    ``detail`` octaves are added to the first, a fractional one in part.
    """
    x, y, z = (np.asarray(a, float) for a in np.broadcast_arrays(x, y, z))
    return _evaluator()[0](x.ravel(), y.ravel(), z.ravel(), float(detail), float(roughness)).reshape(x.shape)


@lru_cache(maxsize=1)
def _evaluator():
    """Noise, margin and density by the fastest implementation at hand: compiled (many times quicker), otherwise NumPy."""
    try:
        from . import noise_kernel
    except ImportError:
        return numpy_evaluator()
    return noise_kernel.noises, noise_kernel.margins, noise_kernel.densities


@lru_cache(maxsize=1)
def numpy_evaluator():
    """The NumPy twins of ``fractal_noise``, ``margin`` and ``density``, the latter two on a shape's ``numbers``."""
    noise, margin_at, density_at, _ = implementation(lambda function: function)

    def over_points(function):
        return lambda shape, position: function(shape, 0, *position.T)

    return noise, over_points(margin_at), over_points(density_at)


def implementation(compiled):
    """Functions noise(x, y, z, detail, roughness), and margin and density of a row of ``numbers`` that begins at ``at``, and
    dust of a row of ``dust_numbers``.

    Their parts are passed through ``compiled``, and there is only arithmetic that scalars and arrays share.
    """

    @compiled
    def rotate(x, k):
        return ((x << k) | (x >> (32 - k))) & _MASK

    @compiled
    def final(a, b, c):
        c = ((c ^ b) - rotate(b, 14)) & _MASK
        a = ((a ^ c) - rotate(c, 11)) & _MASK
        b = ((b ^ a) - rotate(a, 25)) & _MASK
        c = ((c ^ b) - rotate(b, 16)) & _MASK
        a = ((a ^ c) - rotate(c, 4)) & _MASK
        b = ((b ^ a) - rotate(a, 14)) & _MASK
        return ((c ^ b) - rotate(b, 24)) & _MASK

    @compiled
    def lattice_hash(x, y, z):
        return final((_SEED + x) & _MASK, (_SEED + y) & _MASK, (_SEED + z) & _MASK)

    @compiled
    def gradient(h, x, y, z):
        """One of Perlin's twelve edge directions, chosen by the low four bits, times (x, y, z)."""
        h = h & 15
        u = x * (h < 8) + y * (h >= 8)
        third = (h == 12) | (h == 14)
        v = y * (h < 4) + (h >= 4) * (x * third + z * (1 - third))
        return u * (1 - 2 * (h & 1)) + v * (1 - (h & 2))

    @compiled
    def fade(t):
        return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)

    @compiled
    def mix(a, b, t):
        return a + t * (b - a)

    @compiled
    def perlin(x, y, z):
        fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
        i, j, k = np.int64(fx), np.int64(fy), np.int64(fz)
        x, y, z = x - fx, y - fy, z - fz
        u, v, w = fade(x), fade(y), fade(z)
        bottom = mix(
            mix(gradient(lattice_hash(i, j, k), x, y, z), gradient(lattice_hash(i + 1, j, k), x - 1, y, z), u),
            mix(gradient(lattice_hash(i, j + 1, k), x, y - 1, z), gradient(lattice_hash(i + 1, j + 1, k), x - 1, y - 1, z), u),
            v)
        top = mix(
            mix(gradient(lattice_hash(i, j, k + 1), x, y, z - 1), gradient(lattice_hash(i + 1, j, k + 1), x - 1, y, z - 1), u),
            mix(gradient(lattice_hash(i, j + 1, k + 1), x, y - 1, z - 1),
                gradient(lattice_hash(i + 1, j + 1, k + 1), x - 1, y - 1, z - 1), u),
            v)
        return _SCALE * mix(bottom, top, w)

    @compiled
    def noise(x, y, z, detail, roughness):
        whole = int(detail)
        total = 0.0 * x
        amplitude, largest, frequency = 1.0, 0.0, 1.0
        for _ in range(whole + 1):
            total = total + amplitude * perlin(frequency * x, frequency * y, frequency * z)
            largest += amplitude
            amplitude *= roughness
            frequency *= 2.0
        rest = detail - whole
        coarse = 0.5 * total / largest + 0.5
        if rest == 0.0:
            return coarse
        total = total + amplitude * perlin(frequency * x, frequency * y, frequency * z)
        return mix(coarse, 0.5 * total / (largest + amplitude) + 0.5, rest)

    @compiled
    def signed(x):
        """The low 32 bits as a signed integer."""
        return ((x + 0x80000000) & _MASK) - 0x80000000

    @compiled
    def product(a, b):
        """Low 32 bits of a product of signed 32-bit integers, without leaving 64 bits."""
        return signed(a * (b & 0xFFFF) + ((a * (b >> 16) & 0xFFFF) << 16))

    @compiled
    def pcg3d(x, y, z):
        a, b, c = signed(x * 1664525 + 1013904223), signed(y * 1664525 + 1013904223), signed(z * 1664525 + 1013904223)
        a = signed(a + product(b, c))
        b = signed(b + product(c, a))
        c = signed(c + product(a, b))
        a, b, c = a ^ (a >> 16), b ^ (b >> 16), c ^ (c >> 16)
        a = signed(a + product(b, c))
        b = signed(b + product(c, a))
        c = signed(c + product(a, b))
        return (a & 0x7FFFFFFF) / 0x7FFFFFFF, (b & 0x7FFFFFFF) / 0x7FFFFFFF, (c & 0x7FFFFFFF) / 0x7FFFFFFF

    @compiled
    def bits(x):
        """Of the number as float32, as an unsigned integer."""
        return np.int64(np.float32(x).view(np.int32)) & _MASK

    @compiled
    def lookup3(x, y, z):
        x, y, z = bits(x), bits(y), bits(z)
        return (lattice_hash(x, y, z) / _MASK, lookup3_of_four(x, y, z, 0x3F800000) / _MASK,
                lookup3_of_four(x, y, z, 0x40000000) / _MASK)

    @compiled
    def lookup3_of_four(x, y, z, w):
        a, b, c = (_SEED + 4 + x) & _MASK, (_SEED + 4 + y) & _MASK, (_SEED + 4 + z) & _MASK
        a = ((a - c) & _MASK) ^ rotate(c, 4)
        c = (c + b) & _MASK
        b = ((b - a) & _MASK) ^ rotate(a, 6)
        a = (a + c) & _MASK
        c = ((c - b) & _MASK) ^ rotate(b, 8)
        b = (b + a) & _MASK
        a = ((a - c) & _MASK) ^ rotate(c, 16)
        c = (c + b) & _MASK
        b = ((b - a) & _MASK) ^ rotate(a, 19)
        a = (a + c) & _MASK
        c = ((c - b) & _MASK) ^ rotate(b, 4)
        b = (b + a) & _MASK
        return final((a + w) & _MASK, b, c)

    @compiled
    def nearest(x, y, z, cell_hash):
        """Squared distance to the nearest random point."""
        fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
        cx, cy, cz = np.int64(fx), np.int64(fy), np.int64(fz)
        x, y, z = x - fx, y - fy, z - fz
        closest = 0.0 * x + 8.0
        for k in range(-1, 2):
            for j in range(-1, 2):
                for i in range(-1, 2):
                    if cell_hash == 0:
                        u, v, w = pcg3d(cx + i, cy + j, cz + k)
                    else:
                        u, v, w = lookup3(cx + i, cy + j, cz + k)
                    u, v, w = i + u - x, j + v - y, k + w - z
                    closest = np.minimum(closest, u * u + v * v + w * w)
        return closest

    @compiled
    def billows(x, y, z, octaves, roughness, cell_hash):
        """Rounded bulges: BILLOW_MEAN less the weighted mean of the octaves' squared distances."""
        total, largest, amplitude, frequency = 0.0 * x, 0.0, 1.0, 1.0
        for _ in range(octaves):
            total = total + amplitude * nearest(frequency * x, frequency * y, frequency * z, cell_hash)
            largest += amplitude
            amplitude *= roughness
            frequency *= 2.0
        return BILLOW_MEAN - total / largest

    @compiled
    def outline(profile, across, z):
        """Distance from the middle of the body, 1 at the domain's faces; ``across`` is squared, z goes from -1 to 1."""
        if profile == 0:
            return np.sqrt(across + z * z)
        up = 0.5 * z + 0.5
        if profile == 1:
            return np.sqrt(across + up * up)
        if profile == 2:
            return np.sqrt(np.sqrt(across * across + up**4))
        if profile == 3:
            column = np.sqrt(np.sqrt((across / COLUMN_WIDTH**2) ** 2 + up**4))
            level = (up - ANVIL_HEIGHT) / ANVIL_THICKNESS
            return np.minimum(column, np.sqrt(across + level * level))
        return np.sqrt(across**4 + z * z)

    @compiled
    def margin(s, at, x, y, z):
        x, y, z = x - s[at], y - s[at + 1], z - s[at + 2]
        u, v, w = x / s[at + 3], y / s[at + 4], z / s[at + 5]
        distance = outline(int(s[at + 15]), u * u + v * v, w)
        value = s[at + 13] - distance
        x, y, z = (x - s[at + 17]) / s[at + 16], y - s[at + 18], z - s[at + 19]
        if s[at + 12] != 0.0:
            size = s[at + 6]
            n = noise(x / size + s[at + 7], y / size + s[at + 8], z / size + s[at + 9] - EVOLUTION_RISE * s[at + 20],
                      s[at + 10], s[at + 11])
            value = value + s[at + 12] * (2.0 * n - 1.0)
        if s[at + 23] > 0.0 and s[at + 22] != 0.0:
            size = s[at + 21]
            value = value + s[at + 22] * billows(
                x / size + s[at + 7], y / size + s[at + 8], z / size + s[at + 9] - BILLOW_RISE * s[at + 20],
                int(s[at + 23]), s[at + 24], int(s[at + 26]))
        return np.minimum(value, 1.0 - distance) / s[at + 14]

    @compiled
    def density(s, at, x, y, z):
        value = np.minimum(1.0, np.maximum(0.0, margin(s, at, x, y, z)))
        if s[at + 25] > 0.0:
            t = np.minimum(1.0, np.maximum(0.0, (0.5 + 0.5 * (z - s[at + 2]) / s[at + 5]) / s[at + 25]))
            value = value * t * t * (3.0 - 2.0 * t)
        return value

    @compiled
    def dust(s, at, x, y, z):
        size = s[at]
        n = noise(x / size + s[at + 1], y / size + s[at + 2], z / size + s[at + 3], DUST_DETAIL, DUST_ROUGHNESS)
        return np.maximum(0.0, 1.0 + s[at + 4] * (2.0 * n - 1.0))

    return noise, margin, density, dust
