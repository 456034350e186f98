# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures rivals against the truth of each scene, one CSV row per image; what is there already is not measured again."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import median

import numpy as np

from ..reference import select
from ..scene.model import Scene
from .rivals import Rival, RivalFailed, Setting, Shot
from .scenes import BenchScene

Progress = Callable[[str, float], None]

TIMED_RUNS = 3  # of images quicker than a second, the median counts
WARM_UP = 8  # pixels: compiles kernels and shaders before the clock runs


@dataclass(frozen=True)
class Truth:
    """The image a scene is measured against, with the relative RMS of its own error."""

    image: np.ndarray
    error: float
    seconds: float


@dataclass(frozen=True)
class Row:
    """One image of one rival. Errors are relative to the truth's mean; ``digest`` names scene, truth and size."""

    scene: str
    rival: str
    setting: str
    width: int
    height: int
    seconds: float
    rmse: float
    bias: float
    stated_error: float | None
    truth_error: float
    evaluations: int
    digest: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.scene, self.rival, self.setting, self.digest


def digest_of(scene: Scene, bench: BenchScene, width: int, height: int) -> str:
    """Changes when the scene, its truth or the size of the image does."""
    text = repr((scene, bench.truth, sorted(bench.truth_settings.items()), width, height))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def truth_of(bench: BenchScene, scene: Scene, width: int, height: int, folder: Path, digest: str,
             progress: Callable[[float], None] | None = None) -> Truth:
    """The truth from its file in ``folder``, or rendered and written there (whole or not at all)."""
    path = folder / f"truth-{bench.name}-{digest}.npz"
    if path.exists():
        with np.load(path) as stored:
            return Truth(stored["image"], float(stored["error"]), float(stored["seconds"]))
    result = select.load(bench.truth).render(scene, width, height, **{"repeats": 1, "strata": 0, "seed": 12345,
                                                                     "progress": progress, **bench.truth_settings})
    truth = Truth(result.image, float(np.sqrt(np.mean(result.error_estimate**2)) / result.image.mean()), result.seconds)
    folder.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial.npz")
    np.savez_compressed(partial, **asdict(truth))
    partial.replace(path)
    return truth


def errors(image: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Root mean square and mean of image - truth, relative to the truth's mean."""
    difference, mean = image - truth, float(truth.mean())
    return float(np.sqrt(np.mean(difference**2))) / mean, float(difference.mean()) / mean


def read_rows(path: Path) -> list[Row]:
    """The rows of a CSV file written here; none when there is no file. Raises ValueError for another file."""
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        names = [field.name for field in fields(Row)]
        if reader.fieldnames != names:
            raise ValueError(f"{path} does not hold benchmark rows (columns {reader.fieldnames}); remove it or choose another folder")
        kinds = {"width": int, "height": int, "evaluations": int, "seconds": float, "rmse": float, "bias": float,
                 "truth_error": float, "stated_error": lambda text: float(text) if text else None}
        return [Row(**{name: kinds.get(name, str)(entry[name]) for name in names}) for entry in reader
                if None not in entry.values()]  # a row that an interruption cut short is measured again


class Table:
    """The rows on disk: each is appended and flushed as soon as it is measured."""

    def __init__(self, path: Path):
        self.path = path
        self.rows = read_rows(path)
        self._keys = {row.key: row for row in self.rows}

    def get(self, key: tuple[str, str, str, str]) -> Row | None:
        return self._keys.get(key)

    def add(self, row: Row) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        first = not self.path.exists()
        if not first and not self.path.read_bytes().endswith(b"\n"):
            with open(self.path, "ab") as file:  # an interruption has left half a line
                file.write(b"\r\n")
        with open(self.path, "a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, [field.name for field in fields(Row)])
            if first:
                writer.writeheader()
            writer.writerow(asdict(row))
        self.rows.append(row)
        self._keys[row.key] = row


def shoot(rival: Rival, scene: Scene, width: int, height: int, setting: Setting, seed: int) -> tuple[Shot, float]:
    """An image and its wall time; quick ones are repeated and the median time is taken."""
    shot = rival.shoot(scene, width, height, setting, seed)
    times = [shot.seconds]
    while len(times) < TIMED_RUNS and shot.seconds < 1.0:
        times.append(rival.shoot(scene, width, height, setting, seed).seconds)
    return shot, median(times)


def measure(benches: Sequence[BenchScene], rivals: Iterable[Rival], size: int, folder: Path, *, limit: float = 60.0,
            seed: int = 0, progress: Progress | None = None, say: Callable[[str], None] = lambda text: None) -> list[Row]:
    """Rows of every scene and every rival that applies; a rival stops at the first setting slower than ``limit`` seconds.

    Pictures are ``size`` x ``size`` pixels. Rows in ``folder``/bench.csv that belong to the same scenes, truths and size
    are kept and not measured again.
    """
    if size < 1:
        raise ValueError(f"size must be >= 1 pixel, got {size}; 48 is quick")
    report = progress or (lambda what, share: None)
    table = Table(folder / "bench.csv")
    chosen: list[Row] = []
    rivals = list(rivals)
    for bench in benches:
        scene = bench.make()
        digest = digest_of(scene, bench, size, size)
        applying = []
        for rival in rivals:
            if reason := rival.applies(scene):
                say(f"{bench.name}: {rival.name} does not apply: {reason}")
            else:
                applying.append(rival)
        truth = truth_of(bench, scene, size, size, folder, digest, lambda share: report(f"{bench.name}: truth", share))
        say(f"{bench.name}: truth by {bench.truth}, relative error {truth.error:.1e}, {truth.seconds:.1f} s")
        total = sum(len(rival.settings) for rival in applying)
        done = 0
        for rival in applying:
            warm = False
            for index, setting in enumerate(rival.settings):
                text = json.dumps(dict(setting))
                report(f"{bench.name}: {rival.name}", done / total)
                done += 1
                row = table.get((bench.name, rival.name, text, digest))
                if row is None:
                    try:
                        if not warm:
                            rival.shoot(scene, WARM_UP, WARM_UP, rival.settings[0], seed)
                            warm = True
                        row = _row(bench, rival, text, truth, digest, *shoot(rival, scene, size, size, setting, seed))
                    except RivalFailed as error:
                        done += len(rival.settings) - index - 1
                        say(f"{bench.name}: {rival.name} failed: {error}")
                        break
                    table.add(row)
                chosen.append(row)
                if row.seconds > limit:
                    done += len(rival.settings) - index - 1
                    say(f"{bench.name}: {rival.name} stopped at {row.seconds:.0f} s with {text}; the limit is {limit:g} s")
                    break
    return chosen


def _row(bench: BenchScene, rival: Rival, setting: str, truth: Truth, digest: str, shot: Shot, seconds: float) -> Row:
    if not np.isfinite(shot.image).all():
        raise RuntimeError(f"{rival.name} with {setting} made a pixel that is not finite in {bench.name}")
    rmse, bias = errors(shot.image, truth.image)
    height, width = shot.image.shape[:2]
    return Row(bench.name, rival.name, setting, width, height, seconds, rmse, bias, shot.stated_error, truth.error,
               shot.evaluations, digest)


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the (seconds, error) points that no other beats in both, by increasing time."""
    front, best = [], math.inf
    for index in sorted(range(len(points)), key=lambda i: points[i]):
        if points[index][1] < best:
            best = points[index][1]
            front.append(index)
    return front
