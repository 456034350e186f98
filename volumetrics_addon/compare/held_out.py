# SPDX-License-Identifier: GPL-3.0-or-later
"""The error of filtered pictures, measured: each is made from one half of the rounds and compared with the other half.

The halves m_1, m_2 share no random number, so that E[(f(m_1) - m_2)^2] = (f(m_1) - t)^2 + v_2 with the truth t, whatever the
filter f; less the variance v_2 of the other half it tells the filter's error without knowing the truth. The mean of both
filtered pictures is no further from the truth than they are in the mean of squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from ..plan.effort import CONFIDENCE


def error(filtered: Sequence[np.ndarray], halves: Sequence[np.ndarray], variances: Sequence[np.ndarray],
          confidence: float = CONFIDENCE) -> tuple[float, float]:
    """RMSE over pixels and channels of the mean of both filtered pictures, at most; and what it stays under with ``confidence``.

    All are pairs of (height, width, 3); ``variances`` are those of the halves. Pixels are taken as independent, channels are not.
    """
    squares = [(mine - other) ** 2 - variance for mine, other, variance in zip(filtered, reversed(halves), reversed(variances))]
    pixels = np.mean(squares, axis=(0, -1))
    mean, doubt = float(pixels.mean()), float(pixels.std()) / math.sqrt(pixels.size)
    return math.sqrt(max(0.0, mean)), math.sqrt(max(0.0, mean + NormalDist().inv_cdf(confidence) * doubt))
