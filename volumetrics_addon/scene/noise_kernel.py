# SPDX-License-Identifier: GPL-3.0-or-later
"""The functions of ``noise`` compiled with numba, over many points at once. Importing this module needs numba."""

import numba
import numpy as np

from .compilation import forget_stale_kernels
from .noise import implementation

forget_stale_kernels(__file__)
compiled = numba.njit(cache=True)
_noise, _margin, _density, _ = implementation(compiled)


@numba.njit(parallel=True, cache=True)
def noises(x, y, z, detail, roughness):
    """Fractal noise (n,) at coordinates (n,)."""
    result = np.empty(len(x))
    for i in numba.prange(len(x)):
        result[i] = _noise(x[i], y[i], z[i], detail, roughness)
    return result


@numba.njit(parallel=True, cache=True)
def margins(shape, position):
    """Margin (n,) of a row of ``noise.numbers`` at positions (n, 3)."""
    result = np.empty(len(position))
    for i in numba.prange(len(position)):
        result[i] = _margin(shape, 0, position[i, 0], position[i, 1], position[i, 2])
    return result


@numba.njit(parallel=True, cache=True)
def densities(shape, position):
    """Density (n,) of a row of ``noise.numbers`` at positions (n, 3)."""
    result = np.empty(len(position))
    for i in numba.prange(len(position)):
        result[i] = _density(shape, 0, position[i, 0], position[i, 1], position[i, 2])
    return result
