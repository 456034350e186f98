# SPDX-License-Identifier: GPL-3.0-or-later
"""Gauss-Legendre quadrature, the rule that the other modules integrate with."""

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=256)
def gauss_legendre(order, low=-1.0, high=1.0):
    """Nodes and weights, (order,) each and read-only, of Gauss-Legendre quadrature on [low, high].

    Exact for polynomials up to degree 2 order - 1; the weights sum to high - low. Raises ValueError for an order below 1.
    """
    if order < 1:
        raise ValueError(f"order must be >= 1, got {order!r}; a rule has at least one node")
    nodes, weights = np.polynomial.legendre.leggauss(order)
    nodes, weights = (low + high) / 2 + (high - low) / 2 * nodes, (high - low) / 2 * weights
    nodes.setflags(write=False)
    weights.setflags(write=False)
    return nodes, weights
