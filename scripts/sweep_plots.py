# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws what sweep_parameters.py has recorded: a sheet of error curves for each family and engine, and a table of the worst."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sweep_parameters import BASES, EEVEE_SAMPLES, TOLERANCE
from volumetrics_addon.bench.chart import FAINT, PAPER, styled
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.model import Parameter
from volumetrics_addon.plan.model import ENGINES

NAMES = {"cycles": "Cycles", "eevee": "EEVEE"}
COLORS = {"5.2": "#e8833a", "4.5": "#2e86c1"}
OTHER = "#444444"
COLUMNS = 5
LEAST = {"cycles": 0.01, "eevee": 0.05}  # of the error that an axis shows at least


def write(folder: Path) -> None:
    """Sheets into the folder and the table beside it, from its JSON files. Raises ImportError without matplotlib."""
    text = [_INTRODUCTION]
    for family in BASES:
        path = folder / f"{family}.json"
        if not path.exists():
            continue
        data = json.loads(path.read_text(encoding="utf-8"))
        known = {p.name: p for p in FAMILIES[family].parameters}
        swept = [(parameter, data["parameters"][name]) for name, parameter in known.items() if name in data["parameters"]]
        runs = sorted({key for _, entry in swept for key in entry if key.split(" ")[0] in ENGINES}, key=_order)
        base = f"Around *{data['preset']}*" + (f" with {_words(data['base'])}" if data["base"] else "")
        text.append(f"## {FAMILIES[family].label}\n\n{base}, {data['pixels']} pixels wide.\n")
        for engine in ENGINES:
            mine = [run for run in runs if run.startswith(engine)]
            if mine:
                sheet(swept, engine, mine, f"{FAMILIES[family].label} in {NAMES[engine]}", folder / f"{family}-{engine}.png")
                picture = f"{folder.name}/{family}-{engine}.png"
                text.append(f"![Errors of {NAMES[engine]} over the parameters of {family}]({picture})\n")
        heads = [f"{NAMES[run.split(' ')[0]]} {run.split(' ')[1]}" for run in runs]
        text += [f"| parameter | swept | {' | '.join(heads)} |", "|---" * (2 + len(heads)) + "|"]
        text += [f"| `{p.name}` | {_range(entry['values'])} | {' | '.join(_worst(entry, run) for run in runs)} |"
                 for p, entry in swept]
        text.append("")
    (folder.parent / f"{folder.name}.md").write_text("\n".join(text), encoding="utf-8")


_INTRODUCTION = f"""# The error over every parameter

Measured by `python scripts/sweep_parameters.py`, drawn and written by `python scripts/sweep_parameters.py --plot`. One parameter at
a time is moved around a base preset, in small pictures; what has to be set beside it for it to have an effect is written in its
panel. Points are the mean error relative to the reference, bars its 95 % interval; the band is {TOLERANCE:.1%}. Beside each
parameter stands its worst value; about one interval in twenty misses the true error. Pictures are small and samples few: a wide
interval says that the sweep was short there, not that the engine is off. Octaves stand for many orders of scattering, of which the
base follows six; they have errors by construction. EEVEE's own noise, of {EEVEE_SAMPLES} samples (4 in clouds, glass and air), counts as
error. Of the values of fog and godrays seven in eight are within 5 % there, with the plan's own settings: two pixels and 128 slices to a
froxel, volumetric shadows of 32 steps, lamps and sky dimmed to what arrives. Beyond it are falloffs and ends that EEVEE's lamps do not have,
beams narrower than a froxel, blockers with gaps of a pixel, thick fogs under a low sun, layers thinner
than a slice of froxels, and shafts in the compositor.
"""


def _order(run: str) -> tuple:
    engine, version = run.split(" ")
    return ENGINES.index(engine), -float(version)


def _words(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_value(value)}" for name, value in values.items())


def _value(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"({', '.join(map(_value, value))})"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _range(values: Sequence) -> str:
    if len(values) < 7:
        return ", ".join(map(_value, values))
    return f"{_value(values[0])} … {_value(values[-1])}, {len(values)} values"


def _measured(entry: Mapping[str, Any], run: str) -> list[tuple[int, list]]:
    """Index and (error, low, high) of the values with an error."""
    return [(index, result) for index, result in enumerate(entry.get(run, []))
            if isinstance(result, list) and result[0] is not None]


def _worst(entry: Mapping[str, Any], run: str) -> str:
    measured, refused = _measured(entry, run), [r for r in entry.get(run, []) if isinstance(r, str)]
    if not measured:
        return "refused" if refused else ""
    index, (error, low, high) = max(measured, key=lambda item: abs(item[1][0]))
    note = f", {len(refused)} refused" if refused else ""
    return f"{error:+.2%} [{low:+.2%}, {high:+.2%}] at {_value(entry['values'][index])}{note}"


def sheet(swept: Sequence[tuple[Parameter, Mapping[str, Any]]], engine: str, runs: Sequence[str], title: str, path: Path) -> None:
    """Write a panel for each parameter as PNG."""
    shown = [(p, entry) for p, entry in swept if any(run in entry for run in runs)]
    lines = -(-len(shown) // COLUMNS)
    high = 1.9 * lines + 0.5
    with styled((2.55 * COLUMNS, high), path, font=8) as figure:
        figure.text(0.012, 1.0 - 0.32 / high, title, fontsize=14, fontweight="bold")
        for number, run in enumerate(runs):
            version = run.split(" ")[1]
            figure.text(0.985 - 0.09 * number, 1.0 - 0.32 / high, f"Blender {version}", color=COLORS.get(version, OTHER), ha="right")
        for number, (parameter, entry) in enumerate(shown):
            line, column = divmod(number, COLUMNS)
            bottom = high - 0.5 - 1.9 * (line + 1) + 0.42
            axes = figure.add_axes(((column + 0.2) / COLUMNS, bottom / high, 0.74 / COLUMNS, 1.12 / high), facecolor=PAPER)
            _panel(axes, parameter, entry, engine, runs)


def _panel(axes: Any, parameter: Parameter, entry: Mapping[str, Any], engine: str, runs: Sequence[str]) -> None:
    places, logarithmic = _places(parameter, entry["values"])
    reach = LEAST[engine]
    axes.axhspan(-TOLERANCE, TOLERANCE, color="#e4e9d8", zorder=0, linewidth=0)
    axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=1)
    if logarithmic:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.xaxis.set_minor_formatter("")
    for shift, run in enumerate(runs):
        measured = _measured(entry, run)
        if not measured:
            continue
        color = COLORS.get(run.split(" ")[1], OTHER)
        beside = 0.02 * shift * (math.log(max(places) / min(places)) if logarithmic else max(places) - min(places))
        x = [places[index] * math.exp(beside) if logarithmic else places[index] + beside for index, _ in measured]
        y = [error for _, (error, _, _) in measured]
        bars = [[e - low for _, (e, low, _) in measured], [top - e for _, (e, _, top) in measured]]
        axes.errorbar(x, y, bars, color=color, marker="o", markersize=3.2 - 0.6 * shift, linewidth=1.1, elinewidth=0.8,
                      zorder=3 + shift, linestyle="none" if parameter.kind in ("choice", "bool") else "-")
        reach = max(reach, *(1.1 * max(abs(low), abs(top)) for _, (_, low, top) in measured))
        refused = [places[index] for index, result in enumerate(entry[run]) if isinstance(result, str)]
        axes.plot(refused, [0.0] * len(refused), "x", color="#b03a2e", markersize=5, zorder=5)
    axes.set_ylim(-reach, reach)
    axes.yaxis.set_major_formatter(lambda value, _: f"{100.0 * value:.3g}%")
    if parameter.kind in ("choice", "bool", "vector") or _flat(parameter, entry["values"]):
        words = [_value(value) if parameter.kind != "vector" else str(index + 1) for index, value in enumerate(entry["values"])]
        axes.set_xticks(places, [word if len(word) < 12 else word[:11] + "…" for word in words],
                        rotation=90 if len(words) > 7 else 28 if len(words) > 3 and parameter.kind == "choice" else 0, fontsize=6)
        axes.set_xlim(-0.5, len(words) - 0.5)
    elif not logarithmic:
        axes.locator_params(axis="x", nbins=5)
    title = f"{parameter.name} ({parameter.unit})" if parameter.unit else parameter.name
    axes.set_title(title, loc="left", fontsize=8.5, fontweight="bold", pad=11)
    if entry["beside"]:
        beside = _words(entry["beside"])
        axes.text(0.0, 1.03, beside if len(beside) < 46 else beside[:44] + "…", transform=axes.transAxes, fontsize=5.8,
                  color="#777777")
    axes.tick_params(axis="y", labelsize=6.5, length=2)
    axes.tick_params(axis="x", labelsize=5 if len(entry["values"]) > 7 else 6.5, length=2)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _flat(parameter: Parameter, values: Sequence) -> bool:
    return any(isinstance(value, str) for value in values)


def _places(parameter: Parameter, values: Sequence) -> tuple[list[float], bool]:
    """Where the values stand along the axis, and whether it is logarithmic: 0 stands a decade below the least."""
    if parameter.kind in ("choice", "bool", "vector") or _flat(parameter, values):
        return [float(index) for index in range(len(values))], False
    numbers = [float(max(value)) if isinstance(value, list) else float(value) for value in values]
    positive = [number for number in numbers if number > 0.0]
    if parameter.kind != "color" and min(numbers) >= 0.0 and len(positive) > 1 and max(positive) / min(positive) > 30.0:
        return [number or 10.0 ** math.floor(math.log10(min(positive)) - 0.5) for number in numbers], True
    return numbers, False
