# SPDX-License-Identifier: GPL-3.0-or-later
"""Every public function at the combinations of its arguments' extremes, and in every shape of call."""

import numpy as np
import pytest

from .cases import accepted, assert_claims, choices, combinations, count, numbers, parts, usual
from .declared import FUNCTIONS

ELEMENTWISE = [name for name, function in FUNCTIONS.items() if numbers(function)]
REFUSED = 24  # combinations of valid arguments that do not go together, tried one by one


def grid_of_extremes(name, limit):
    """Elements asserted over the combinations, the choices sharing them out."""
    function = FUNCTIONS[name]
    settings = choices(function)
    total = 0
    for i, setting in enumerate(settings):
        arguments = combinations(f"{name} {i}", function, max(limit // len(settings), 2))
        if not arguments and function.valid and not function.valid(**setting):
            with pytest.raises(ValueError, match="; "):
                function(**setting)
            total += 1
            continue
        if not arguments:
            total += assert_claims(function, setting, (), function(**setting))
            continue
        good = accepted(function, arguments)
        assert good.any()
        valid = {key: value[good] for key, value in arguments.items()} | setting
        total += assert_claims(function, valid, (int(good.sum()),), function(**valid))
        for row in np.flatnonzero(~good)[:: max(1, int((~good).sum()) // REFUSED)]:
            with pytest.raises(ValueError, match="; "):
                function(**{key: value[row] for key, value in arguments.items()}, **setting)
            total += 1
    return total


@pytest.mark.parametrize("name", FUNCTIONS)
def test_extremes(name):
    count("extremes", name, grid_of_extremes(name, FUNCTIONS[name].limit))


@pytest.mark.sweep
@pytest.mark.parametrize("name", FUNCTIONS)
def test_extremes_in_full(name):
    count("extremes", name, grid_of_extremes(name, 50 * FUNCTIONS[name].limit))


def assert_close(function, field, value, expected):
    if function.rounding:
        scale = np.max(np.abs(expected), initial=0.0, where=np.isfinite(expected))
        np.testing.assert_allclose(value, expected, rtol=function.rounding, atol=function.rounding * scale, err_msg=field)
    else:
        np.testing.assert_array_equal(value, expected, err_msg=field)


def same(function, one, other, shape):
    """Equal fields, to the last bit or to the stated rounding; the number of elements."""
    total = 0
    for (field, claim, a), (_, _, b) in zip(parts(function, one), parts(function, other)):
        if claim.trailing is not None:
            assert a.shape == (*shape, *claim.trailing), field
        assert_close(function, field, a, np.reshape(b, a.shape))
        total += a.size
    return total


def ordinary(function, n):
    """n rows around the ordinary values of the arguments, exact in single precision."""
    rows = {}
    for i, (name, kind) in enumerate(numbers(function).items()):
        if kind.shape:
            rows[name] = np.tile(np.array(kind.usual), (n, 1))
        else:
            reach = 0.0 if np.isinf(kind.usual) else 0.125 * min(1.0, kind.usual - kind.low, kind.high - kind.usual)
            rows[name] = kind.usual - reach * ((np.arange(n) + i) % n) / n if reach else np.full(n, kind.usual)
            rows[name] = rows[name].astype(np.float32).astype(np.float64)
            rows[name] = np.where(kind.holds(rows[name]), rows[name], kind.usual)
    return rows


@pytest.mark.parametrize("name", ELEMENTWISE)
def test_shapes_of_calls(name):
    """Rows, single numbers, empty arrays and columns against rows give the same values."""
    function = FUNCTIONS[name]
    kinds = numbers(function)
    setting = {key: value for key, value in usual(function).items() if key not in kinds}
    # Each column varies one argument only by column, each row the others by row.
    flat = ordinary(function, 4)
    total = 0
    together = function(**flat, **setting)
    for row in (0, 3):
        alone = function(**{key: value[row] for key, value in flat.items()}, **setting)
        picked = [value[row] for _, _, value in parts(function, together)]
        for (field, claim, value), expected in zip(parts(function, alone), picked):
            if claim.trailing is not None:
                assert value.shape == claim.trailing
            assert_close(function, field, value, expected)
            total += value.size
    empty = function(**{key: value[:0] for key, value in flat.items()}, **setting)
    for field, claim, value in parts(function, empty):
        assert value.shape[0] == 0 and (claim.trailing is None or value.shape == (0, *claim.trailing)), field
        total += 1
    crossed = {key: value[:3, np.newaxis] if i % 2 else value for i, (key, value) in enumerate(flat.items())}
    if len(kinds) > 1:
        shape = (3, 4)
        spread = {
            key: np.broadcast_to(value, (*shape, *kinds[key].shape)).reshape(12, *kinds[key].shape)
            for key, value in crossed.items()
        }
        total += same(function, function(**crossed, **setting), function(**spread, **setting), shape)
    count("shapes", name, total)


@pytest.mark.parametrize("name", ELEMENTWISE)
def test_single_precision_is_computed_in_double(name):
    """float32 arguments give the very result of the same numbers in float64."""
    function = FUNCTIONS[name]
    kinds = numbers(function)
    setting = {key: value for key, value in usual(function).items() if key not in kinds}
    arguments = combinations(name, function, min(function.limit // 6, 500))
    with np.errstate(over="ignore"):
        single = {key: value.astype(np.float32) for key, value in arguments.items()}
    double = {key: value.astype(np.float64) for key, value in single.items()}
    good = accepted(function, double)
    for key, kind in kinds.items():
        good = good & (np.abs(double[key]).max(axis=1) < np.inf if kind.shape else kind.holds(double[key]))
    assert good.any()
    single, double = ({key: value[good] for key, value in rows.items()} for rows in (single, double))
    count("single", name, same(function, function(**single, **setting), function(**double, **setting), (int(good.sum()),)))
