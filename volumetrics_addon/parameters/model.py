# SPDX-License-Identifier: GPL-3.0-or-later
"""What a parameter is, and how a value is checked against its declaration.

Preset keys, command-line options, node-group sockets, UI properties and the table in the docs are all
derived from these declarations. Standard library only: enabling the add-on imports this module.
"""

from __future__ import annotations

import math
import os
import unicodedata
from dataclasses import dataclass
from typing import Any, Mapping

KINDS = ("float", "int", "bool", "choice", "color", "vector", "text", "path")


class ParameterError(ValueError):
    """A value that its declaration refuses; the message names value, limit and remedy."""


def shown(value: Any) -> str:
    """The value as a message shows it: at most 80 characters, whatever it is."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or values nested too deeply
        text = f"<{type(value).__name__} too long to write>"
    return text if len(text) <= 80 else text[:77] + "..."


def decimal(value: float) -> float:
    """The decimal number that a float32 stands for. Blender holds 0.999 as 0.99900001, beyond its own limit."""
    return float(f"{value:.7g}")


@dataclass(frozen=True)
class Parameter:
    """One declared parameter.

    ``minimum`` and ``maximum`` are hard limits (refused beyond), ``soft_minimum`` and ``soft_maximum`` the
    range of a slider. ``live`` parameters become sockets of the node group and react at once; the others are
    fixed when the tree is built. Angles are declared, stored and shown in degrees and become radians in the
    Scene. ``color`` and ``vector`` are triples, their limits hold per component. A ``path`` names a file, empty none: in a
    preset relative to the preset's folder, on the command line to the working directory.
    """

    name: str
    kind: str
    default: Any
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    soft_minimum: float | None = None
    soft_maximum: float | None = None
    live: bool = False
    choices: tuple[tuple[str, str], ...] = ()
    exclusive_minimum: bool = False
    title: str = ""  # shown to users where the name alone would not tell them what it is
    # Name of another parameter of the group, and the values of it beside which this one has an effect; none: any but 0.
    when: tuple[str, ...] = ()
    # The same for the socket of a live parameter: beside other values it has its effect when the tree is built, and then none.
    live_when: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        assert self.kind in KINDS, self.kind
        assert (self.kind == "choice") == bool(self.choices), self.name
        self.check(self.default)

    @property
    def label(self) -> str:
        return self.title or self.name.replace("_", " ").capitalize()

    @property
    def soft_range(self) -> tuple[float | None, float | None]:
        low = self.minimum if self.soft_minimum is None else self.soft_minimum
        high = self.maximum if self.soft_maximum is None else self.soft_maximum
        return low, high

    @property
    def limits(self) -> str:
        """The allowed values in words, for messages and tables."""
        if self.kind == "choice":
            return "one of " + ", ".join(repr(name) for name, _ in self.choices)
        if self.kind == "bool":
            return "true or false"
        if self.kind in ("text", "path"):
            return f"one line of at most {self.maximum:g} characters"
        low = "" if self.minimum is None else f"{'>' if self.exclusive_minimum else '>='} {self.minimum:g}"
        high = "" if self.maximum is None else f"<= {self.maximum:g}"
        words = " and ".join(filter(None, (low, high))) or "any number"
        if self.kind in ("color", "vector"):
            words = f"three numbers, each {words}"
        return f"{words} {self.unit}".strip() if self.unit else words

    def check(self, value: Any) -> Any:
        """The value in canonical form (float, int, bool, str or a triple of floats).

        Raises ParameterError when the type is wrong, a number is not finite, or a limit is passed.
        """
        match self.kind:
            case "bool":
                if not isinstance(value, bool):
                    self._refuse(value, "write true or false")
                return value
            case "choice":
                names = [name for name, _ in self.choices]
                if value not in names:
                    self._refuse(value, "choose one of these")
                return value
            case "text" | "path":
                if not isinstance(value, str):
                    self._refuse(value, "write it in quotes")
                if len(value) > self.maximum:
                    self._refuse(value, "shorten it")
                if any(unicodedata.category(character) == "Cc" for character in value):
                    self._refuse(value, "take out line breaks and control characters")
                return value
            case "int":
                if isinstance(value, bool) or not isinstance(value, int):
                    self._refuse(value, "write a whole number")
                return int(self._check_number(value, value))
            case "float":
                return self._check_number(value, value)
            case _:
                if not isinstance(value, (list, tuple)) or len(value) != 3:
                    self._refuse(value, "write three numbers, such as [1.0, 1.0, 1.0]")
                return tuple(self._check_number(component, value) for component in value)

    def parse(self, text: str) -> Any:
        """The value from a command-line word: triples as ``r,g,b``."""
        try:
            match self.kind:
                case "bool":
                    return self.check({"true": True, "false": False}.get(text.lower(), text))
                case "int":
                    return self.check(int(text))
                case "path":
                    return self.check(os.path.abspath(text) if text else text)
                case "float":
                    return self.check(float(text))
                case "color" | "vector":
                    return self.check([float(word) for word in text.split(",")])
        except ParameterError:
            raise
        except ValueError:
            self._refuse(text, "give three numbers as 1,1,1" if self.kind in ("color", "vector") else "give a number")
        return self.check(text)

    def _check_number(self, component: Any, value: Any) -> float:
        """The component as a float; ``value`` is what the message shows, all three of a triple."""
        if isinstance(component, bool) or not isinstance(component, (int, float)):
            self._refuse(value, "write a number")
        try:
            number = float(component)
        except OverflowError:
            self._refuse(value, "bring it within these limits")
        if not math.isfinite(number):
            self._refuse(value, "write a finite number")
        below = self.minimum is not None and (number <= self.minimum if self.exclusive_minimum else number < self.minimum)
        above = self.maximum is not None and number > self.maximum
        if below or above:
            self._refuse(value, "bring it within these limits")
        return number

    def _refuse(self, value: Any, remedy: str) -> None:
        raise ParameterError(f"{self.name} = {shown(value)} is not allowed (allowed: {self.limits}); {remedy}")


@dataclass(frozen=True)
class Group:
    """A named set of parameters: a family (cloud, glass, ...) or a part of the stage it is shown on."""

    name: str
    label: str
    description: str
    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.parameters]
        assert len(names) == len(set(names)), f"{self.name} declares a parameter twice"
        rules = [rule for parameter in self.parameters for rule in (parameter.when, parameter.live_when) if rule]
        assert all(rule[0] in names for rule in rules), self.name

    def __getitem__(self, name: str) -> Parameter:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    @property
    def live(self) -> tuple[Parameter, ...]:
        return tuple(parameter for parameter in self.parameters if parameter.live)

    def applies(self, name: str, values: Mapping[str, Any]) -> bool:
        """Whether the parameter has an effect beside these values of all parameters."""
        return self._holds(self[name].when, values)

    def reacts(self, name: str, values: Mapping[str, Any]) -> bool:
        """Whether the parameter is live and its socket has an effect beside these values."""
        return self[name].live and self.applies(name, values) and self._holds(self[name].live_when, values)

    def _holds(self, rule: tuple[str, ...], values: Mapping[str, Any]) -> bool:
        if not rule:
            return True
        other, *effective = rule
        return (values[other] in effective if effective else bool(values[other])) and self.applies(other, values)

    def defaults(self) -> dict[str, Any]:
        return {parameter.name: parameter.default for parameter in self.parameters}

    def check(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """All parameters in canonical form: the given values checked, the others at their default.

        Raises ParameterError on an unknown name or a refused value.
        """
        known = {parameter.name for parameter in self.parameters}
        for name in values:
            if name not in known:
                raise ParameterError(f"unknown key {shown(name)} in {self.name}; known keys: {', '.join(sorted(known))}")
        result = self.defaults()
        for name, value in values.items():
            result[name] = self[name].check(value)
        return result
