# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that arrives at points of a medium, compiled: the path tracer of ``path_kernel`` started at the points.

Importing this module needs numba.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from .path_kernel import (
    CHUNKS, ROW, SPAN, along, arriving, dot, hashed, minus, next_event, phase_value, sample_phase, scaled, trace, turned, vector,
)
from .path_scene import LIGHT, LIGHTS, VOLUME, VOLUMES


@numba.njit(parallel=True, error_model="numpy", cache=True)
def trace_points(scene, index, orders, eye, points, samples, first, seed):
    """Mean over ``samples`` paths of J (n, 3) at ``points`` (n, 3), and of its square, see ``light_grid``.

    ``index`` counts the volumes of the flattened scene, ``orders`` the scattering events before the one at the point, ``first``
    the samples made before; ``seed`` is an uint64.
    """
    mean, square = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    v = int(scene[VOLUMES + 1]) + index * VOLUME
    for chunk in numba.prange(CHUNKS):
        work = np.empty(SPAN * int(scene[VOLUMES]) + ROW * int(scene[LIGHTS]))
        state = np.empty(1, np.uint64)
        for i in range(chunk, len(points), CHUNKS):
            point = (points[i, 0], points[i, 1], points[i, 2])
            view = minus(point, (eye[0], eye[1], eye[2]))
            view = scaled(view, 1.0 / max(math.sqrt(dot(view, view)), 1e-300))
            for sample in range(first, first + samples):
                state[0] = hashed(seed + np.uint64(0x9E3779B97F4A7C15) * np.uint64(sample * len(points) + i + 1))
                value = (0.0, 0.0, 0.0)
                for l in range(int(scene[LIGHTS])):
                    toward, distance, direct = arriving(scene, int(scene[LIGHTS + 1]) + l * LIGHT, point)
                    factor = phase_value(scene, v, min(1.0, max(-1.0, dot(toward, view))))
                    value = along(value, next_event(scene, scaled(direct, factor), point, toward, distance, state), 1.0)
                direction = turned(view, sample_phase(scene, v, state), state)
                arrived, _ = trace(scene, orders, point, direction, work, state)
                value = along(value, arrived, 1.0)
                for c in range(3):
                    mean[i, c] += value[c] / samples
                    square[i, c] += value[c] * value[c] / samples
    return mean, square
