# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark in words: who reaches which error first, and how far each rival gets."""

from __future__ import annotations

import json
from collections.abc import Sequence

from .chart import label, percent
from .run import Row, pareto_front

GOALS = (0.1, 0.01, 0.001)


def seconds(value: float) -> str:
    return f"{value * 1e3:.3g} ms" if value < 1.0 else f"{value:.3g} s"


def first_to(rows: Sequence[Row], goal: float) -> Row | None:
    """The quickest row with at most that error."""
    return min((row for row in rows if row.rmse <= goal), key=lambda row: row.seconds, default=None)


def summary(rows: Sequence[Row]) -> str:
    """Markdown: one line per scene with the quickest rival to each error, then one line per scene and rival."""
    scenes = list(dict.fromkeys(row.scene for row in rows))
    lines = ["| scene | " + " | ".join(f"first to {percent(goal)}" for goal in GOALS) + " | most accurate | truth's own error |",
             "|---" * (len(GOALS) + 3) + "|"]
    for scene in scenes:
        mine = [row for row in rows if row.scene == scene]
        cells = []
        for goal in GOALS:
            best = first_to(mine, goal)
            cells.append(f"{label(best.rival)}, {seconds(best.seconds)}" if best else "none")
        best = min(mine, key=lambda row: row.rmse)
        cells.append(f"{label(best.rival)}, {percent(best.rmse)} in {seconds(best.seconds)}")
        lines.append(f"| {scene} | " + " | ".join(cells) + f" | {percent(best.truth_error)} |")
    lines += ["", "| scene | rival | best RMSE | its mean error | its time | setting | on the front |", "|---|---|---|---|---|---|---|"]
    for scene in scenes:
        mine = [row for row in rows if row.scene == scene]
        front = [mine[i] for i in pareto_front([(row.seconds, row.rmse) for row in mine])]
        for rival in sorted({row.rival for row in mine}, key=lambda name: min(row.rmse for row in mine if row.rival == name)):
            best = min((row for row in mine if row.rival == rival), key=lambda row: row.rmse)
            setting = ", ".join(f"{key.rsplit('.', 1)[-1]} {value}" for key, value in json.loads(best.setting).items())
            count = sum(row.rival == rival for row in front)
            lines.append(f"| {scene} | {label(rival)} | {percent(best.rmse)} | {100.0 * best.bias:+.3g}% | {seconds(best.seconds)} | "
                         f"{setting} | {count or ''} |")
    return "\n".join(lines) + "\n"
