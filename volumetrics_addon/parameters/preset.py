# SPDX-License-Identifier: GPL-3.0-or-later
"""Preset files: TOML in, checked plain values out. Nothing in a preset is ever executed."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Mapping

from .families import FAMILIES
from .model import Group, Parameter, ParameterError, shown
from .stage import PROP, STAGE

FORMAT = 1
MAX_BYTES = 1 << 17  # MAX_PROPS props with every digit take 1 << 16
MAX_PROPS = 256
MAX_DOTS = 128  # in one line: the parser's time grows with the square of the parts of a dotted key

_HEADER = Group("preset", "Preset", "Name and description of a preset.", (
    Parameter("label", "text", "", "Name shown to the user.", maximum=80),
    Parameter("description", "text", "", "One sentence on what it shows.", maximum=500),
))


class PresetError(ValueError):
    """A preset that is refused; the message names file, key, value, limit and remedy."""


@dataclass(frozen=True)
class Preset:
    """A checked preset: every parameter of its family and stage is present in canonical form."""

    name: str
    family: str
    label: str
    description: str
    parameters: Mapping[str, Any]
    stage: Mapping[str, Any]
    props: tuple[Mapping[str, Any], ...] = ()

    @property
    def group(self) -> Group:
        return FAMILIES[self.family]

    def changed(self, parameters: Mapping[str, Any], stage: Mapping[str, Any] | None = None) -> "Preset":
        """The preset with some values replaced. Raises ParameterError."""
        return replace(self, parameters=self.group.check({**self.parameters, **parameters}),
                       stage=STAGE.check({**self.stage, **(stage or {})}))


def directory() -> Path:
    """The folder of the presets that come with the package."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "presets"  # installed
    return inside if inside.is_dir() else package.parent / "presets"  # source tree


def names() -> list[str]:
    """Names of the presets that come with the package, sorted."""
    return sorted(path.stem for path in directory().glob("*.toml"))


def load(name_or_path: str | Path) -> Preset:
    """The preset of that name, or in that file. Raises PresetError."""
    text = str(name_or_path)
    path = Path(text)
    if path.suffix != ".toml":
        if text not in names():
            raise PresetError(f"no preset is named {shown(text)}; known: {', '.join(names())}; "
                              "or give the path of a .toml file")
        path = directory() / f"{text}.toml"
    return parse(_read(path), path)


def _read(path: Path) -> bytes:
    try:
        if not path.is_file():
            reason = "this is not a file" if path.exists() else "there is no such file"
            raise PresetError(f"{path}: {reason}; check the path")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise PresetError(f"{path}: the file has {size} bytes, a preset at most {MAX_BYTES}; is it a preset?")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise PresetError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    if len(data) > MAX_BYTES:
        raise PresetError(f"{path}: the file grew beyond {MAX_BYTES} bytes while it was read; is it a preset?")
    return data


def parse(data: bytes, path: Path) -> Preset:
    """The preset in ``data``; ``path`` names it and appears in messages. Raises PresetError."""
    dots = max(line.count(b".") for line in data.split(b"\n"))
    if dots > MAX_DOTS:
        raise PresetError(f"{path}: a line has {dots} dots, a preset at most {MAX_DOTS}; break the line")
    try:
        document = tomllib.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise PresetError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise PresetError(f"{path}: not valid TOML: {error}; mend the file there") from None
    except (RecursionError, ValueError) as error:
        # deeply nested values, or integers of thousands of digits
        raise PresetError(f"{path}: cannot be parsed ({type(error).__name__}); simplify the file") from None

    version = document.pop("format", None)
    if type(version) is not int or version != FORMAT:
        raise PresetError(f"{path}: format = {shown(version)} is not supported; this version reads format = {FORMAT}, "
                          "write that at the top or update Volumetrics")
    family = document.pop("family", None)
    if not isinstance(family, str) or family not in FAMILIES:
        raise PresetError(f"{path}: family = {shown(family)} is not known; choose one of {', '.join(FAMILIES)}")

    parameters = _table(path, "parameters", FAMILIES[family], document.pop("parameters", {}))
    for parameter in FAMILIES[family].parameters:
        if parameter.kind == "path" and parameters[parameter.name]:
            parameters[parameter.name] = os.path.join(path.absolute().parent, parameters[parameter.name])
    stage = _table(path, "stage", STAGE, document.pop("stage", {}))
    props = document.pop("props", [])
    if not isinstance(props, list):
        raise PresetError(f"{path}: props = {shown(props)} must be a list of tables; write each below [[props]]")
    if len(props) > MAX_PROPS:
        raise PresetError(f"{path}: {len(props)} props are too many; keep at most {MAX_PROPS}")
    checked = tuple(_table(path, f"props[{index}]", PROP, values) for index, values in enumerate(props))
    for key in document:
        if key not in _HEADER.defaults():
            known = "format, family, label, description, [parameters], [stage], [[props]]"
            raise PresetError(f"{path}: unknown key {shown(key)} at the top level; known: {known}")
    header = _table(path, "top level", _HEADER, document)
    return Preset(path.stem, family, header["label"] or path.stem, header["description"], parameters, stage, checked)


def _table(path: Path, where: str, group: Group, values: Any) -> dict[str, Any]:
    if not isinstance(values, dict):
        title = "[[props]]" if group is PROP else f"[{where}]"
        raise PresetError(f"{path}: {where} = {shown(values)} must be a table; write its keys below {title}")
    try:
        return group.check(values)
    except ParameterError as error:
        raise PresetError(f"{path}: in {where}: {error}") from None


def to_toml(preset: Preset) -> str:
    """The preset as a file: only what differs from the declared defaults is written."""
    lines = [f"format = {FORMAT}", f"family = {_toml(preset.family)}", f"label = {_toml(preset.label)}",
             f"description = {_toml(preset.description)}"]
    tables = [("[parameters]", preset.group, preset.parameters), ("[stage]", STAGE, preset.stage)]
    tables += [("[[props]]", PROP, values) for values in preset.props]
    for title, group, values in tables:
        lines += ["", title]
        lines += [f"{p.name} = {_toml(values[p.name])}" for p in group.parameters if values[p.name] != p.default]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            escaped = value.replace("\\", "\\\\").replace('"', '\\"')
            return f'"{escaped}"'
        case tuple():
            return "[" + ", ".join(_toml(component) for component in value) + "]"
        case _:
            return repr(value)
