# SPDX-License-Identifier: GPL-3.0-or-later
"""Cases from the declarations: combinations of arguments, what is asserted of each element, and how many there were."""

from __future__ import annotations

import zlib
from collections import Counter
from itertools import product
from math import prod

import numpy as np

from .declared import Choice, Claim, Function

asserted: Counter[str] = Counter()  # elements by part
functions: set[str] = set()
integrators: set[str] = set()


def count(part: str, name: str, elements: int) -> None:
    asserted[part] += elements
    (functions if "." in name else integrators).add(name)


def numbers(function: Function) -> dict:
    """The arguments that take arrays."""
    return {name: kind for name, kind in function.arguments.items() if not isinstance(kind, Choice)}


def choices(function: Function) -> list[dict]:
    """Every combination of the arguments that are one for a whole call."""
    kinds = {name: kind for name, kind in function.arguments.items() if isinstance(kind, Choice)}
    return [dict(zip(kinds, values)) for values in product(*(kind.values for kind in kinds.values()))]


def usual(function: Function) -> dict:
    return {name: kind.usual for name, kind in function.arguments.items()}


def combinations(name: str, function: Function, limit: int) -> dict:
    """Arrays (n, *shape) over all combinations of extremes, or a sample of ``limit`` of them that is always the same."""
    kinds = numbers(function)
    sizes = [len(kind.values) for kind in kinds.values()]
    total = prod(sizes)
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    chosen = np.arange(total) if total <= limit else np.unique(rng.integers(total, size=limit))
    index = np.unravel_index(chosen, sizes) if sizes else ()
    return {name: np.array(kind.values)[i] for (name, kind), i in zip(kinds.items(), index)}


def accepted(function: Function, arguments: dict) -> np.ndarray:
    """Which of the combinations the function takes."""
    n = len(next(iter(arguments.values())))
    if function.valid is None:
        return np.ones(n, bool)
    with np.errstate(all="ignore"):
        return np.broadcast_to(function.valid(**arguments), n)


def parts(function: Function, result) -> list[tuple[str, Claim, np.ndarray]]:
    """(name, claim, array) of everything that a result holds."""
    match function.claim:
        case Claim() as claim:
            return [("result", claim, np.asarray(result))]
        case dict() as claims:
            return [(field, claim, np.asarray(getattr(result, field))) for field, claim in claims.items()]
        case claims:
            assert len(claims) == len(result)
            return [(str(i), claim, np.asarray(value)) for i, (claim, value) in enumerate(zip(claims, result))]


def assert_claims(function: Function, arguments: dict, shape: tuple[int, ...], result) -> int:
    """Every claim for every element, with the arguments of the first that breaks one; the number of elements."""
    total = 0
    for field, claim, value in parts(function, result):
        if claim.trailing is not None:
            assert value.shape == (*shape, *claim.trailing), (field, value.shape, shape)
        rest = (1,) * (value.ndim - len(shape))
        with np.errstate(all="ignore"):
            infinite, may = (
                np.reshape(np.broadcast_to(rule(**arguments), shape), shape + rest) for rule in (claim.infinite, claim.may)
            )
        broken = {
            "NaN": np.isnan(value),
            "below the range": value < claim.low,
            "above the range": value > claim.high,
            "infinite": np.isinf(value) & ~infinite & ~may,
            "finite": np.isfinite(value) & infinite,
        }
        for what, where in broken.items():
            if where.any():
                first = tuple(np.argwhere(where)[0])
                case = {
                    name: array[first[: len(shape)]].tolist()
                    if isinstance(array, np.ndarray) and name in numbers(function)
                    else array
                    for name, array in arguments.items()
                }
                raise AssertionError(
                    f"{field} is {what} ({value[first]!r}) in {where.sum()} of {value.size} elements, such as {case}"
                )
        total += value.size
    return total
