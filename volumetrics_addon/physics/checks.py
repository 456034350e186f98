# SPDX-License-Identifier: GPL-3.0-or-later
"""Argument checks: every error carries the name, the condition, the value and the remedy.

Each function converts its argument to a float64 array and returns it, so that a
caller checks and converts in one line. NaN fails every condition.
"""

import numpy as np

# Unit vectors and cosines that come out of a dot product miss 1 by rounding;
# how much is decided by the precision the caller computed in.
_ROUNDING_STEPS = 16

_LARGEST_COORDINATE = 1e100


def checked(name, value, condition, must, remedy):
    """``value`` as a float64 array, or ValueError naming its first bad element.

    ``condition`` maps the array to booleans, ``must`` and ``remedy`` complete the
    sentence "<name> must be <must>, got <value>; <remedy>".
    """
    array = np.asarray(value, dtype=np.float64)
    good = condition(array)
    if not np.all(good):
        bad = float(array[~good].flat[0])
        raise ValueError(f"{name} must be {must}, got {bad!r}; {remedy}")
    return array


def finite(name, value, unit, remedy="use a finite number"):
    """``value`` as float64, finite."""
    return checked(name, value, np.isfinite, f"a finite number of {unit}", remedy)


def nonnegative(name, value, unit, remedy):
    """``value`` as float64, finite and >= 0."""
    return checked(
        name, value, lambda x: (x >= 0) & (x < np.inf), f"finite and >= 0 {unit}", remedy
    )


def nonnegative_or_infinite(name, value, unit, remedy):
    """``value`` as float64, >= 0; infinity passes."""
    return checked(name, value, lambda x: x >= 0, f">= 0 {unit}", remedy)


def positive(name, value, unit, remedy):
    """``value`` as float64, finite and > 0."""
    return checked(
        name, value, lambda x: (x > 0) & (x < np.inf), f"finite and > 0 {unit}", remedy
    )


def fraction(name, value, remedy="give a fraction from 0 to 1"):
    """``value`` as float64 in [0, 1]."""
    return checked(name, value, lambda x: (x >= 0) & (x <= 1), "in [0, 1]", remedy)


def cosine(name, value):
    """``value`` as float64 in [-1, 1]; excess within rounding of a dot product is clipped."""
    limit = 1 + _rounding(value)
    array = checked(
        name,
        value,
        lambda x: np.abs(x) <= limit,
        "in [-1, 1]",
        "pass the cosine of an angle, from normalised directions",
    )
    return np.clip(array, -1.0, 1.0)


def vector(name, value, unit):
    """``value`` as a float64 array of shape (..., 3) with components whose squares are finite."""
    array = checked(
        name,
        value,
        lambda x: np.abs(x) <= _LARGEST_COORDINATE,
        f"at most {_LARGEST_COORDINATE:g} {unit} in size",
        "use finite coordinates",
    )
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(
            f"{name} must have shape (..., 3), got {array.shape}; "
            "put x, y and z along the last axis"
        )
    return array


def unit_vector(name, value):
    """``value`` as float64 (..., 3) of length 1 to single precision, renormalised to double."""
    array = vector(name, value, "direction components")
    length = np.sqrt(np.sum(array * array, axis=-1, keepdims=True))
    slack = _ROUNDING_STEPS * np.finfo(np.float32).eps
    checked(
        f"length of {name}",
        length,
        lambda x: np.abs(x - 1) <= slack,
        "1",
        "normalise the direction",
    )
    return array / length


def _rounding(value):
    dtype = getattr(value, "dtype", np.dtype(np.float64))
    resolution = np.finfo(dtype).eps if np.issubdtype(dtype, np.floating) else 0.0
    return _ROUNDING_STEPS * max(float(resolution), float(np.finfo(np.float64).eps))
