# SPDX-License-Identifier: GPL-3.0-or-later
"""Markdown tables for the documentation, from the declarations and from measured results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..parameters.families import FAMILIES
from ..parameters.preset import load, names
from ..parameters.stage import PROP, STAGE
from ..plan.catalogue import BY_NAME, PRESET_RULES, RULES, TARGET_RULES
from ..plan.model import CYCLES, EEVEE, ENGINES

_ENGINE_NAMES = {CYCLES: "Cycles", EEVEE: "EEVEE"}


def parameters() -> str:
    """One table per group of parameters."""
    lines = []
    for group in (*FAMILIES.values(), STAGE, PROP):
        lines += [f"## {group.label} (`{group.name}`)", "", group.description, "",
                  "| parameter | default | allowed | live | meaning |", "|---|---|---|---|---|"]
        lines += [f"| `{p.name}` | {_value(p.default)} | {p.limits} | {'yes' if p.live else ''} | {p.description} |"
                  for p in group.parameters]
        lines.append("")
    return "\n".join(lines).rstrip()


def presets(folder: Path) -> str:
    """Every preset with the errors that ``verify`` wrote to the folder. Raises ValueError when a result is missing."""
    lines = ["| preset | family | shows | Cycles error | EEVEE error |", "|---|---|---|---|---|"]
    for name in names():
        preset = load(name)
        cells = [_error(folder / f"{name}-{engine}.json") for engine in ENGINES]
        lines.append(f"| `{name}` | {preset.family} | {preset.description} | {' | '.join(cells)} |")
    return "\n".join(lines)


def integrators() -> str:
    """Every integrator with its summary, its bias and the settings that the benchmark runs."""
    from ..reference import select

    lines = ["| integrator | what it does | its error by construction | settings of the benchmark |", "|---|---|---|---|"]
    for name in select.NAMES:
        module = select.load(name)
        settings = "; ".join(", ".join(f"{key} {value}" for key, value in setting.items()) for setting in module.SETTINGS)
        lines.append(f"| `{name}` | {select.summary(module)} | {module.BIAS} | {settings} |")
    return "\n".join(lines)


def rules() -> str:
    """The rules for a user's own scene, those by which presets are built, and those of renders to an error."""
    lines = []
    for title, chosen in (("A scene of your own", RULES), ("Presets", PRESET_RULES), ("To an error, or within a time", TARGET_RULES)):
        lines += [f"## {title}", "", "| rule | engines | applies where | leaves out | bound or error | gain | switched off by |",
                  "|---|---|---|---|---|---|---|"]
        for rule in chosen.values():
            gain = "; ".join(f"{_ENGINE_NAMES[engine]} {times:g} x" for engine, times in rule.gain.items())
            gain = f"{gain} on {rule.shown_by}" if gain else ""
            switch = f"`{BY_NAME} '{rule.name}'`" if chosen is RULES or rule.switch == BY_NAME else f"`{rule.switch}`" if rule.switch else ""
            lines.append(f"| {rule.name} | {', '.join(_ENGINE_NAMES[engine] for engine in rule.engines)} | {rule.condition} | "
                         f"{rule.leaves_out} | {rule.guarantee} | {gain} | {switch} |")
        lines.append("")
    return "\n".join(lines).rstrip()


def _error(path: Path) -> str:
    try:
        figures = json.loads(path.read_text(encoding="utf-8"))["comparison"]
    except FileNotFoundError:
        raise ValueError(f"{path} is missing; run 'volumetrics verify all --engine cycles' and '... --engine eevee' "
                         f"with --out {path.parent}") from None
    low, high = figures["mean_relative_interval"]
    return f"{figures['mean_relative_error']:+.2%} [{low:+.2%}, {high:+.2%}]"


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{v:g}" for v in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
