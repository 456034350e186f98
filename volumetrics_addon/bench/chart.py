# SPDX-License-Identifier: GPL-3.0-or-later
"""One chart per scene: seconds against relative RMSE, with the Pareto front and the truth's own error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..compare.report import display
from .run import Row, pareto_front
from .rivals import names

# Engines and references stand out, relatives share a hue.
COLORS = {
    "cycles": "#e8833a", "eevee": "#2e86c1", "path_tracing": "#b03a2e", "single_scattering": "#111111", "dielectric": "#111111",
    "ray_marching": "#1e8449", "quarter_resolution": "#58b368", "froxels": "#7d9d1f", "light_slices": "#17a589",
    "half_angle_slices": "#7fb3a6", "octaves": "#8e44ad", "ambient_scattering": "#c158b8", "ambient_occlusion": "#d7a1d2",
    "emission_absorption": "#a08fb5", "adding_doubling": "#6e4b1f", "sky_single_scattering": "#5d6d7e", "sky_tables": "#1f4e79",
    "aerial_perspective": "#5fa8d3", "preetham_sky": "#c0a030", "depth_fog": "#2e8b57", "depth_air": "#003366",
}
MARKERS = "oDs^vP*Xph<>"
INK, FAINT, PAPER = "#1a1a1a", "#c9c4ba", "#fbf9f4"


def chart(rows: Sequence[Row], title: str, path: Path, truth: np.ndarray | None = None) -> None:
    """Write the chart of one scene's rows as PNG. Raises ImportError with the remedy when matplotlib is missing."""
    with styled((12.8, 7.2), path) as figure:
        axes = figure.add_axes((0.075, 0.1, 0.645, 0.8), facecolor=PAPER)
        _draw(axes, rows)
        axes.set_xlabel("seconds")
        axes.set_ylabel("relative RMSE")
        figure.text(0.075, 0.935, title, fontsize=17, fontweight="bold")
        pixels = f"{rows[0].width} x {rows[0].height} pixels"
        figure.text(0.72, 0.937, f"{pixels}, both axes logarithmic", ha="right", fontsize=10, color="#666666")
        figure.legend(*axes.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.735, 0.62 if truth is not None else 0.9),
                      frameon=False, fontsize=10.5, labelspacing=0.45)
        if truth is not None:
            picture = figure.add_axes((0.745, 0.64, 0.2, 0.26))
            picture.imshow(display(truth, _exposure(truth)), interpolation="nearest")
            picture.set_anchor("NW")
            picture.set_axis_off()


def overview(scenes: Sequence[tuple[str, Sequence[Row]]], path: Path) -> None:
    """Write the charts of all scenes, (title, rows) each, on one sheet as PNG. Raises ImportError as ``chart`` does."""
    columns = min(4, len(scenes))
    lines = -(-len(scenes) // columns)
    with styled((4.2 * columns + 2.4, 3.3 * lines + 0.4), path, font=9) as figure:
        shown: dict[str, object] = {}
        share = 4.2 * columns / (4.2 * columns + 2.4)
        for index, (title, rows) in enumerate(scenes):
            line, column = divmod(index, columns)
            axes = figure.add_axes((share * (column + 0.16) / columns, (lines - line - 0.86) / lines, share * 0.8 / columns,
                                    0.72 / lines), facecolor=PAPER)
            _draw(axes, rows, size=0.7)
            axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
            handles, labels = axes.get_legend_handles_labels()
            shown.update(zip(labels, handles))
        order = [*(label(name) for name in names()), *shown]
        labels = sorted(shown, key=order.index)
        figure.legend([shown[name] for name in labels], labels, loc="upper left", bbox_to_anchor=(share, 0.97), frameon=False,
                      title="seconds across, relative RMSE up", alignment="left", title_fontsize=9)


@contextmanager
def styled(size: tuple[float, float], path: Path, font: float = 11) -> Iterator[object]:
    """A figure in the house style that becomes the PNG ``path``, whole or not at all."""
    try:
        import matplotlib
    except ImportError as error:
        raise ImportError("the charts are drawn by matplotlib, which is missing; install it with: pip install matplotlib") from error
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"font.family": "DejaVu Sans", "font.size": font, "axes.edgecolor": FAINT, "text.color": INK,
                                "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK}):
        figure = Figure(figsize=size, dpi=100, facecolor=PAPER)
        FigureCanvasAgg(figure)
        yield figure
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.stem}.partial.png")
        figure.savefig(partial, facecolor=PAPER)
        partial.replace(path)


def _exposure(image: np.ndarray) -> float:
    """Stops that bring the mean of the image to a middle grey."""
    return float(np.log2(0.3 / max(image.mean(), 1e-12)))


def _draw(axes, rows: Sequence[Row], size: float = 1.0) -> None:
    order = {name: index for index, name in enumerate(names())}
    rivals = sorted({row.rival for row in rows}, key=order.__getitem__)
    for rival in rivals:
        mine = [row for row in rows if row.rival == rival]  # in the order of its settings
        engine = rival in ("cycles", "eevee")
        axes.plot([row.seconds for row in mine], [row.rmse for row in mine], label=label(rival), color=COLORS[rival],
                  marker=MARKERS[order[rival] % len(MARKERS)], markersize=6.5 * size, linewidth=(2.2 if engine else 1.3) * size,
                  zorder=4 if engine else 3)
    points = [(row.seconds, row.rmse) for row in rows]
    front = [points[i] for i in pareto_front(points)]
    axes.step([p[0] for p in front] + [max(p[0] for p in points) * 1.5], [p[1] for p in front] + [front[-1][1]], where="post",
              color=FAINT, linewidth=7 * size, solid_capstyle="round", zorder=1, label="Pareto front")
    floor = rows[0].truth_error
    axes.set_xscale("log")
    axes.set_yscale("log")
    low = min(p[1] for p in points)
    if floor > 0.05 * low:
        axes.axhspan(0.1 * min(low, floor), floor, color="#eadfc8", zorder=0, label="the truth's own error", linewidth=0)
        axes.set_ylim(bottom=0.5 * min(low, floor))
    axes.yaxis.set_major_formatter(lambda value, _: percent(value))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter("")
    axes.yaxis.set_minor_formatter("")
    axes.grid(True, which="major", color=FAINT, linewidth=0.5, alpha=0.7)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def label(rival: str) -> str:
    return {"cycles": "Cycles", "eevee": "EEVEE"}.get(rival, rival.replace("_", " "))


def percent(value: float) -> str:
    """20 -> 2000%, 1.5 -> 150%, 0.01 -> 1%, 1e-5 -> 0.001%, below that a power of ten."""
    if value >= 10.0:
        return f"{100.0 * value:.0f}%"
    return f"{100.0 * value:.3g}%" if value >= 0.9e-5 else f"{value:.0e}"
