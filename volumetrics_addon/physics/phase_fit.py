# SPDX-License-Identifier: GPL-3.0-or-later
"""The two Henyey-Greenstein lobes nearest to a phase function that is given as a table or in code.

Engines offer Henyey-Greenstein lobes; measured and computed phase functions come as tables. The fit says
how far apart the two are, in one number that is itself the quantity it minimises.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from . import checks, phase
from .quadrature import gauss_legendre

_MAX_STEPS = 300
_STEPS_OF_ALL = 25
_SMALLEST_SHARE = 1e-60
# The logistic function of a parameter still differs from 1 here.
_LARGEST_PARAMETER = 20.0
# Peaks that the quadrature of a callable resolves, in radians.
_NARROWEST = 1e-4


class DualHenyeyGreensteinFit(NamedTuple):
    """norm * ((1 - weight) HG(g0) + weight HG(g1)), g0 >= g1, nearest to a phase function.

    residual: root mean square over the sphere of fit / value - 1, or of ln(fit / value).
    mean_cosine: of the fit, (1 - weight) g0 + weight g1; given_mean_cosine: of what was given.
    norm: what the fit integrates to over the sphere; given_norm: what was given does.
    """

    g0: float
    g1: float
    weight: float
    residual: float
    mean_cosine: float
    given_mean_cosine: float
    norm: float
    given_norm: float


def fit_dual_henyey_greenstein(cos_theta, value, logarithmic=False, keep_mean_cosine=False, free_norm=False):
    """DualHenyeyGreensteinFit to the values > 0 of a phase function at cos_theta, both (n,).

    ``value`` may be a callable of cos_theta instead, with None for cos_theta: it is asked at the nodes of a
    quadrature that resolves peaks down to 1e-4 radians, both forward and backward. A table may have any
    order and unit and needs 5 different cosines or more. It stands for the whole sphere: each value for
    the solid angle between the middles to its neighbours, the outer ones up to +-1.

    Minimised is the residual: the relative root mean square error, each direction weighted by its solid
    angle, or with ``logarithmic`` that of the logarithm, which counts too dark as much as too bright and
    is the better choice where the values span decades. The fit integrates over the sphere to what the
    table does, or with ``free_norm`` to whatever makes the residual smallest: for tables too coarse or
    too short to be integrated. With ``keep_mean_cosine`` the fit has the mean cosine of the given
    function exactly, so that diffusion and similarity relations carry over.

    Lobes that a table cannot tell from a delta are not considered: 1 - |g| is at least the angle between
    its outermost cosines on that side, and 1e-4.

    Levenberg-Marquardt from 20 or more starts at once, the best 4 of which are carried on.
    Sources: Marquardt, SIAM Journal on Applied Mathematics 11 (1963); Golub and Pereyra, SIAM Journal
    on Numerical Analysis 10 (1973), for the scale that is solved within.
    """
    cos_theta, value, solid_angle = _table(cos_theta, value)
    largest = np.max(value)
    value = checks.checked(
        "value, of its largest,",
        value / largest,
        lambda x: x >= _SMALLEST_SHARE,
        f"at least {_SMALLEST_SHARE:g}",
        "the residual is relative; leave out what counts as dark",
    )
    share = solid_angle / np.sum(solid_angle)
    power = share * value
    given_mean = float(np.sum(power * cos_theta) / np.sum(power))
    given_norm = 4 * np.pi * np.sum(power)
    value = value / given_norm
    low, high = _resolved(cos_theta)
    lobes = _free_lobes(low, high)
    if keep_mean_cosine:
        within = f"in ({low:.6g}, {high:.6g}), what the table resolves"
        checks.checked("mean cosine of value", given_mean, lambda x: (low < x) & (x < high), within, "give a finer table")
        lobes = _lobes_around(given_mean, low, high)
    compare = _log_ratio if logarithmic else _ratio

    def evaluate(parameters):
        """Weighted residuals (starts, n), their derivatives (starts, n, parameters), and scales."""
        (g0, g1, weight), slopes = lobes(parameters)
        first, second = _lobe(cos_theta, g0), _lobe(cos_theta, g1)
        mixed = (1 - weight[:, np.newaxis]) * first[0] + weight[:, np.newaxis] * second[0]
        by_lobes = np.stack(
            [(1 - weight[:, np.newaxis]) * first[1], weight[:, np.newaxis] * second[1], second[0] - first[0]], axis=-1
        )
        y = mixed / value
        residual, derivative, scale = compare(y, by_lobes @ slopes / value[:, np.newaxis], share, free_norm)
        root = np.sqrt(share)
        return residual * root, derivative * root[:, np.newaxis], scale

    parameters = _descend(evaluate, _starts(keep_mean_cosine, low, high))
    residuals, _, scales = evaluate(parameters)
    squares = np.sum(residuals * residuals, axis=-1)
    best = np.argmin(squares)
    g0, g1, weight = (float(x[best]) for x in lobes(parameters)[0])
    if g0 < g1:
        g0, g1, weight = g1, g0, 1 - weight
    with np.errstate(over="ignore"):
        norm = largest * given_norm
        return DualHenyeyGreensteinFit(
            g0, g1, weight, float(np.sqrt(squares[best])), (1 - weight) * g0 + weight * g1, given_mean,
            float(norm * scales[best]), float(norm),
        )  # fmt: skip


# --- what is fitted ----------------------------------------------------------------


def _table(cos_theta, value):
    """Cosines in order, values there, and the solid angles they stand for over 2 pi."""
    if cos_theta is None:
        if not callable(value):
            raise ValueError("cos_theta is needed with a table, got None; give the cosines, or a callable as value")
        cos_theta, solid_angle = _sphere_rule()
        return cos_theta, _positive(value(cos_theta), cos_theta.shape), solid_angle
    cos_theta = checks.cosine("cos_theta", cos_theta)
    if cos_theta.ndim != 1 or np.unique(cos_theta).size < 5:
        raise ValueError(f"cos_theta must have shape (n,) with 5 different values or more, got shape {cos_theta.shape}; "
                         "give a finer table")  # fmt: skip
    value = _positive(value(cos_theta) if callable(value) else value, cos_theta.shape)
    order = np.argsort(cos_theta)
    cos_theta, value = cos_theta[order], value[order]
    middles = (cos_theta[1:] + cos_theta[:-1]) / 2
    return cos_theta, value, np.diff(np.concatenate([[-1.0], middles, [1.0]]))


def _positive(value, shape):
    value = checks.positive("value", value, "(phase function)", "the residual is relative; leave out zeros")
    if value.shape != shape:
        raise ValueError(f"value must have the shape of cos_theta, {shape}, got {value.shape}; one value a cosine")
    return value


def _resolved(cos_theta):
    """The smallest and largest g whose lobes are as wide as the table's steps at the poles."""
    theta = np.arccos(cos_theta[[0, -1]])
    steps = theta - np.arccos([np.min(cos_theta[cos_theta > cos_theta[0]]), np.max(cos_theta[cos_theta < cos_theta[-1]])])
    backward, forward = np.clip(np.abs(steps), _NARROWEST, 1.0)
    return backward - 1, 1 - forward


@lru_cache(maxsize=1)
def _sphere_rule():
    """Gauss-Legendre in theta, 8 points a panel; panels double away from both poles and stay below 0.1."""
    width, ends = _NARROWEST, [0.0]
    while ends[-1] < np.pi / 2:
        ends.append(ends[-1] + width)
        width = min(2 * width, 0.1)
    ends = np.array(ends) * (np.pi / 2 / ends[-1])
    ends = np.concatenate([ends, np.pi - ends[-2::-1]])
    nodes, weights = gauss_legendre(8)
    half = np.diff(ends)[:, np.newaxis] / 2
    theta = ((ends[1:] + ends[:-1])[:, np.newaxis] / 2 + half * nodes).ravel()[::-1]
    return np.cos(theta), (half * weights).ravel()[::-1] * np.sin(theta)


# --- the model ------------------------------------------------------------------------
#
# Parameters are unbounded. Each model maps (starts, parameters) to g0, g1 and weight, and to their
# derivatives (starts, 3, parameters).


def _free_lobes(low, high):
    def lobes(parameters):
        shares = _logistic(parameters)
        slope = shares * _logistic(-parameters) * (high - low, high - low, 1)
        g0, g1, weight = (shares * (high - low, high - low, 1) + (low, low, 0)).T
        return (g0, g1, weight), slope[:, np.newaxis] * np.eye(3)

    return lobes


def _lobes_around(mean, low, high):
    """One lobe on either side of the mean cosine, which then fixes the weight."""

    def lobes(parameters):
        above, below = (_logistic(parameters) * (high - mean, mean - low)).T
        d_above, d_below = np.array([above, below]) * _logistic(-parameters.T)
        apart = above + below
        slopes = np.zeros((len(above), 3, 2))
        slopes[:, 0, 0], slopes[:, 1, 1] = d_above, -d_below
        slopes[:, 2, 0], slopes[:, 2, 1] = below / apart**2 * d_above, -above / apart**2 * d_below
        return (mean + above, mean - below, above / apart), slopes

    return lobes


def _logistic(x):
    return 1 / (1 + np.exp(-x))


def _lobe(cos_theta, g):
    """Henyey-Greenstein (starts, n) and its derivative by g."""
    g = g[:, np.newaxis]
    value = phase.henyey_greenstein(cos_theta, g)
    squared = (1 - np.abs(g)) ** 2 + 2 * np.abs(g) * (1 - np.sign(g) * cos_theta)
    return value, value * (3 * (cos_theta - g) / squared - 2 * g / ((1 - g) * (1 + g)))


def _ratio(y, slope, share, free):
    """s y - 1 with the best s, or 1, and its derivatives."""
    if not free:
        return y - 1, slope, np.ones(len(y))
    mean, square = y @ share, (y * y) @ share
    s = (mean / square)[:, np.newaxis]
    along = np.einsum("j,sjp->sp", share, slope) - 2 * s * np.einsum("sj,sjp->sp", y * share, slope)
    turned = (along / square[:, np.newaxis])[:, np.newaxis]
    return s * y - 1, s[..., np.newaxis] * slope + turned * y[..., np.newaxis], s[:, 0]


def _log_ratio(y, slope, share, free):
    """ln(s y) with the best s, or 1, and its derivatives."""
    log, slope = np.log(y), slope / y[..., np.newaxis]
    if not free:
        return log, slope, np.ones(len(y))
    mean = log @ share
    residual = log - mean[:, np.newaxis]
    return residual, slope - np.einsum("j,sjp->sp", share, slope)[:, np.newaxis], np.exp(-mean)


# --- Levenberg-Marquardt ------------------------------------------------------------------


def _starts(keep_mean_cosine, low, high):
    if keep_mean_cosine:
        return np.array([(a, b) for a in (-4, -2, 0, 2, 4) for b in (-4, -2, 0, 2)], dtype=float)
    pairs = [(g0, g1) for g0 in (0.2, 0.6, 0.9, 0.99) for g1 in (-0.6, -0.1, 0.4, 0.8) if g1 < g0]
    share = np.clip((np.array(pairs) - low) / (high - low), 0.01, 0.99)
    lobes = np.log(share / (1 - share))
    return np.array([(*lobe, c) for lobe in lobes for c in (-1.0, 1.5)])


def _descend(evaluate, parameters):
    """Least squares from all starts at once, each with its own damping."""
    residual, derivative, _ = evaluate(parameters)
    cost = np.sum(residual * residual, axis=-1)
    damping = np.full(len(cost), 1e-2)
    for count in range(_MAX_STEPS):
        gradient = np.einsum("sjp,sj->sp", derivative, residual)
        normal = np.einsum("sjp,sjq->spq", derivative, derivative)
        diagonal = np.einsum("spp->sp", normal)
        # A parameter without effect still gets a finite step.
        floor = 1e-12 * np.max(diagonal, axis=-1, keepdims=True) + np.finfo(np.float64).tiny
        ridge = (damping[:, np.newaxis] * np.maximum(diagonal, floor))[..., np.newaxis] * np.eye(parameters.shape[1])
        step = np.linalg.solve(normal + ridge, gradient[..., np.newaxis])[..., 0]
        trial = np.clip(parameters - step, -_LARGEST_PARAMETER, _LARGEST_PARAMETER)
        new_residual, new_derivative, _ = evaluate(trial)
        new_cost = np.sum(new_residual * new_residual, axis=-1)
        better = new_cost < cost
        still = np.all(np.abs(trial - parameters) <= 1e-12 * (1 + np.abs(parameters)), axis=-1)
        settled = still | (better & (cost - new_cost <= 1e-14 * cost))
        parameters = np.where(better[:, np.newaxis], trial, parameters)
        residual = np.where(better[:, np.newaxis], new_residual, residual)
        derivative = np.where(better[:, np.newaxis, np.newaxis], new_derivative, derivative)
        cost = np.where(better, new_cost, cost)
        damping = np.clip(np.where(better, damping / 5, damping * 4), 1e-15, 1e15)
        if np.all(settled):
            break
        if count == _STEPS_OF_ALL:
            best = np.argsort(cost)[:4]
            parameters, residual, derivative, cost, damping = (
                x[best] for x in (parameters, residual, derivative, cost, damping)
            )
    return parameters
