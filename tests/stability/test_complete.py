# SPDX-License-Identifier: GPL-3.0-or-later
"""Nothing public is left out: every function and method of ``physics`` is declared, every integrator rendered."""

import inspect
from importlib import import_module
from pathlib import Path

import pytest

from volumetrics_addon import physics

from .declared import EXCEPTED, FUNCTIONS

MODULES = sorted(path.stem for path in Path(physics.__file__).parent.glob("*.py") if path.stem not in ("__init__", "checks"))


def public(module):
    """Names of the functions defined in a module, and of the methods of its classes, ``__call__`` included."""
    for name, value in vars(module).items():
        if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(value):
            yield from (
                f"{name}.{method}"
                for method, member in vars(value).items()
                if (not method.startswith("_") or method == "__call__") and inspect.isfunction(member)
            )
        elif callable(value):
            yield name


@pytest.mark.parametrize("module", MODULES)
def test_every_public_function_is_declared(module):
    found = set(public(import_module(f"volumetrics_addon.physics.{module}")))
    assert found, "a module without a public function"
    declared = {name.split(".", 1)[1] for name in (*FUNCTIONS, *EXCEPTED) if name.startswith(module + ".")}
    assert found == declared


def test_nothing_is_declared_twice_or_excepted_without_reason():
    assert len(MODULES) >= 11 and len(FUNCTIONS) >= 90
    assert not set(FUNCTIONS) & set(EXCEPTED)
    assert all(len(reason) > 20 for reason in EXCEPTED.values())


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_is_declared(name):
    function = FUNCTIONS[name]
    if function.function.__name__ == "<lambda>" or function.unchecked or "." in name.split(".", 1)[1]:
        return
    declared = set(function.arguments) - set(function.further)
    assert declared <= set(inspect.signature(function.function).parameters) <= declared | {"rng"}
