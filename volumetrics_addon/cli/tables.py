# SPDX-License-Identifier: GPL-3.0-or-later
"""Markdown tables for the documentation, from the declarations and from measured results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..parameters.families import FAMILIES
from ..parameters.preset import load, names
from ..parameters.stage import PROP, STAGE
from ..plan.model import ENGINES


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
