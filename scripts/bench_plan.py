# SPDX-License-Identifier: GPL-3.0-or-later
"""Stock settings against planned ones: seconds at equal error for scenes the way users make them, side by side in one run.

    python scripts/bench_plan.py [SCENE ...] [--engine cycles|eevee] [--size 48] [--repeats 3] [--error 0.03] [--limit 20]
        [--truth 120] [--converged 64] [--finest 1,256] [--pilot] [--clock] [--alone] [--only RULES] [--without RULES]
        [--out bench/plan.csv] [--table FILE]

Stock: the scene's own settings, Blender's start-up ones plus what its tutorial sets. Planned: the same scene after the planner.
Denoising is off for both, since it hides the noise that is compared; samples climb a ladder by fours, stock and planned taking
turns, until the wanted error is reached or the samples take longer than the limit. Seconds are those of all processors (other
work on the machine changes them little) and of the clock, of the picture and of the pilot by which a noise threshold is planned;
planning besides is timed by scripts/bench_tool.py.

Each picture is planned for its own size and samples; where the rules for 1920 x 1080 pixels are others, these are measured too, and
the gain at that size is theirs.

The truth is the stock picture converged, several seeds, adaptive sampling off, kept beside the CSV under a digest. The error is
the relative RMSE against it, less its own variance. Both ladders are read at the wanted error or the nearest that both pass. The
bias is the mean of the converged planned picture over that of the converged stock one, with its 95 % interval; where the plan sets a
noise threshold, also that of --means pictures of the ladder's last rung, adaptive sampling on.

EEVEE keeps media in froxels, cells of the screen, and is off by their width, however many its samples. Its truth is what ever finer
cells and more samples come to, with all of the scene's own settings besides: cells of one pixel, 256 steps (or those of --finest), the
largest memory for shadows and --converged samples; of
an animation it takes the middle frame. Stock is the start-up file's 64 samples, planned what the plan sets; and the first rung of each
ladder that is as good as stock is read too. With --pilot the plan may render one, whose seconds are then its own; with --clock gains are
those of the clock, as where a GPU renders. The bias is the mean of the planned picture with --converged samples over that of the truth.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import inspect
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import geometric_mean

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: E402

from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.bench.equal_error import (  # noqa: E402
    Rung, at_error, common_error, rms, seconds_at_size, soonest,
)
from volumetrics_addon.blender import compat, render, settings, stage, tuning  # noqa: E402
from volumetrics_addon.compare.statistics import Estimate, compare  # noqa: E402
from volumetrics_addon.plan import tuning as tuned  # noqa: E402
from volumetrics_addon.plan.model import CYCLES, EEVEE  # noqa: E402

FULL_HD, LARGE = 1920 * 1080, "planned for HD"
FEWEST_SAMPLES, USUAL_SAMPLES = 4, 256  # of a pixel, for which the rules are listed: of a small picture, and of a large one
IDLE = {"persistent data", "passes"}  # rules that change nothing of a single picture
STOCK_EEVEE_SAMPLES = 64
EEVEE_STEPS = 256  # the most that it takes along the view
FINEST = f"1,{EEVEE_STEPS}"  # pixels across a froxel of EEVEE's truth, and their number along the view
MOST_SAMPLES = 16384
AS_GOOD = 1.01  # times an error
LONG = 3.0  # processor seconds of a picture that is taken once


@dataclass
class Way:
    """Stock, planned, or one rule of the plan alone."""

    name: str
    rules: tuple[str, ...] | None  # None: all
    pixels: int = 0  # of the picture that is planned for; 0: of the one that is rendered
    ladder: list[Rung] = field(default_factory=list)


class Bench:
    """One scene in one engine: builds it, applies ways, takes pictures."""

    def __init__(self, scene: usual.UsualScene, engine: str, size: int, without: tuple[str, ...], most: int, finest: str = FINEST,
                 pilot: bool = False):
        self.usual, self.engine, self.without, self.most, self.pilot = scene, engine, without, most, pilot
        tile, slices = words(finest)
        self.finest = {"eevee.volumetric_tile_size": tile, "eevee.volumetric_samples": int(slices),
                       "eevee.shadow_pool_size": tuned.LARGEST_POOL}
        self.piloted: tuple[list, tuple[float, float]] | None = None  # EEVEE's plan with a pilot, and the seconds of that
        self.width, self.height = size, max(1, round(size * 9 / 16))
        self.frames = scene.frames if engine == CYCLES else scene.frames[len(scene.frames) // 2:][:1]
        self.built: bpy.types.Scene | None = None

    def plan(self, pixels: int = 0) -> list:
        return self._plan(self.build(), USUAL_SAMPLES if pixels else FEWEST_SAMPLES, pixels)

    def _plan(self, scene: bpy.types.Scene, samples: int, pixels: int, pilot: bool = False) -> list:
        return tuning.plan(scene, without=self.without, samples=samples, pixels=pixels or self.width * self.height, pilot=pilot)

    def thresholds(self, samples: int, pixels: int) -> bool:
        """Whether the plan for so many samples sets a noise threshold."""
        return any(one.rule.name == tuning.NOISE_RULE for one in self._plan(self.build(), samples, pixels, True))

    def build(self) -> bpy.types.Scene:
        scene = self.usual.build()
        scene.render.engine = "CYCLES" if self.engine == CYCLES else compat.current().eevee
        return scene

    @contextmanager
    def dressed(self, way: Way, samples: int, pilot: bool):
        """The scene with the way's settings, and the seconds of its pilot, of all processors and of the clock. EEVEE keeps one scene,
        whose shaders are compiled once."""
        if self.built is None or self.engine == CYCLES:
            self.built = self.build()
        scene = self.built
        if way.rules == ():
            yield scene, (0.0, 0.0)
            return
        seconds = 0.0, 0.0
        if self.engine == EEVEE and self.pilot:
            if not self.piloted:
                plain = self._timed_plan(scene, samples, way.pixels, False)[1]
                advice, taken = self._timed_plan(scene, samples, way.pixels, True)
                self.piloted = advice, tuple(max(0.0, more - less) for more, less in zip(taken, plain))
            advice, seconds = self.piloted
        else:
            advice, without = self._timed_plan(scene, samples, way.pixels, False)
        if self.engine == CYCLES and pilot and not way.pixels and (way.rules is None or tuning.NOISE_RULE in way.rules):
            advice, taken = self._timed_plan(scene, samples, way.pixels, True)
            seconds = tuple(max(0.0, more - less) for more, less in zip(taken, without))
        tuning.apply(scene, [one for one in advice if way.rules is None or one.rule.name in way.rules])
        yield scene, seconds
        tuning.restore(scene)

    def _timed_plan(self, scene: bpy.types.Scene, samples: int, pixels: int, pilot: bool) -> tuple[list, tuple[float, float]]:
        cpu, wall = time.process_time(), time.perf_counter()
        advice = self._plan(scene, samples, pixels, pilot)
        return advice, (time.process_time() - cpu, time.perf_counter() - wall)

    def shoot(self, way: Way, samples: int | None, seed: int = 0, converged: bool = False) -> tuple[np.ndarray, float, float]:
        """The picture, all frames below each other; seconds of all processors and of the clock. Without ``samples`` EEVEE has those
        of its settings."""
        with self.dressed(way, samples or STOCK_EEVEE_SAMPLES, not converged) as (scene, pilot):
            scene.cycles.use_denoising, own = False, scene.eevee.taa_render_samples
            if samples:
                scene.cycles.samples = scene.eevee.taa_render_samples = samples
            if converged:
                scene.cycles.use_adaptive_sampling = False
                scene.render.use_persistent_data = False
            cpu, wall = time.process_time(), time.perf_counter()
            frames, heard = [], []
            for frame in self.frames:
                if len(self.usual.frames) > 1:
                    scene.frame_set(frame)
                frames.append(render.render_built(scene, self.width, self.height, seed=seed, heard=heard)[0])
            seconds = time.process_time() - cpu + pilot[0], time.perf_counter() - wall + pilot[1]
            scene.eevee.taa_render_samples = own
        if full := next((line for line in heard if stage.SHADOWS_FULL.search(line)), ""):
            say(f"   {way.name}: {full}")
        return np.concatenate(frames), *seconds

    def converged(self, way: Way, budget: float) -> np.ndarray:
        """Pictures (k, ...) of consecutive seeds that take about the budget of processor seconds together; of EEVEE one."""
        if self.engine == EEVEE:
            self.shoot(way, 1)  # compiles
            before = settings.apply(self.built, self.finest)
            picture = self.shoot(way, self.most)[0]
            settings.restore(self.built, before)
            return picture[None]
        _, few, _ = self.shoot(way, 1, 1000, converged=True)
        _, more, _ = self.shoot(way, 33, 1000, converged=True)
        each = max((more - few) / 32, 1e-6)
        repeats = 8 if few < 0.02 * budget else 4
        samples = int(np.clip((budget / repeats - few) / each, 128, 65536))
        return np.stack([self.shoot(way, samples, 1001 + seed, converged=True)[0] for seed in range(repeats)])

    def truth(self, budget: float, folder: Path) -> np.ndarray:
        """The converged stock pictures, from their file or rendered and kept there."""
        source = inspect.getsource(usual).partition("# --- the scenes")[0] + inspect.getsource(self.usual.fill)
        digest = hashlib.sha256(repr((source, self.frames, bpy.app.version_string, self.engine, self.width, self.height,
                                      budget if self.engine == CYCLES else (self.most, self.finest))).encode()).hexdigest()[:12]
        path = folder / f"{self.engine}-{self.usual.name}-{digest}.npz"
        if path.exists():
            with np.load(path) as stored:
                return stored["pictures"].astype(np.float64)
        pictures = self.converged(Way("stock", ()), budget)
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.partial.npz")
        np.savez_compressed(partial, pictures=pictures.astype(np.float32))
        partial.replace(path)
        return pictures


def climb(bench: Bench, ways: list[Way], truth: np.ndarray, wanted: float, limit: float, repeats: int) -> None:
    """Fill the ladders, the ways taking turns; each stops at the wanted error, the limit, or the most samples."""
    mean, variance = truth.mean(axis=0), truth.var(axis=0, ddof=1) / len(truth)
    samples, climbing = FEWEST_SAMPLES, list(ways)
    while climbing and samples <= bench.most:
        shots: dict[str, list] = {way.name: [] for way in climbing}
        for repeat in range(repeats):
            for way in climbing:
                if repeat == 0 or shots[way.name][0][1] < LONG:
                    shots[way.name].append(bench.shoot(way, samples, repeat))
        for way in list(climbing):
            pictures, cpu, wall = zip(*shots[way.name])
            error = rms(np.stack(pictures), mean, variance)
            way.ladder.append(Rung(samples, float(np.median(cpu)), float(np.median(wall)), error))
            done = way.ladder[-1].error <= wanted and len(way.ladder) > 1
            if done or way.ladder[-1].cpu - way.ladder[0].cpu > limit:  # what is fixed has to be paid at any error
                climbing.remove(way)
        samples *= 4


def row(bench: Bench, way: Way, stock: Way, bias: tuple[float, float, float], wanted: float, rules: str) -> dict:
    """What the ladders say of one way against stock."""
    error = common_error([way.ladder, stock.ladder], wanted)
    cpu, wall = ([at_error(one.ladder, error, what) for one in (stock, way)] for what in ("cpu", "wall"))
    pixels = FULL_HD / (bench.width * bench.height)
    return {
        "scene": bench.usual.name, "engine": bench.engine, "version": bpy.app.version_string, "way": way.name,
        "error": error, "stock_cpu": cpu[0], "cpu": cpu[1], "gain": cpu[0] / cpu[1], "gain_wall": wall[0] / wall[1],
        "gain_hd": seconds_at_size(stock.ladder, error, pixels) / seconds_at_size(way.ladder, error, pixels),
        "bias": bias[0], "bias_low": bias[1], "bias_high": bias[2], "rules": rules}


def measure_eevee(bench: Bench, arguments: argparse.Namespace) -> list[dict]:
    """Stock and planned with their own samples, and the fewest of each with which they are as good as stock."""
    stock, planned = Way("stock", ()), Way("planned", arguments.only)
    for way in (stock, planned):
        bench.shoot(way, 1)  # compiles
    rules = list(dict.fromkeys(one.rule.name for one in (bench.piloted[0] if bench.piloted else bench.plan())))
    say(f"## {bench.usual.name}, {bench.engine}, Blender {bpy.app.version_string}: {', '.join(rules) or 'nothing to plan'}")
    truth = bench.truth(0.0, arguments.out.parent / "truth")[0]
    seconds = (lambda rung: rung.wall) if arguments.clock else (lambda rung: rung.cpu)

    def shot(way: Way, samples: int | None) -> tuple[Rung, float]:
        pictures, cpu, wall = zip(*(bench.shoot(way, samples) for _ in range(arguments.repeats)))
        rung = Rung(samples or STOCK_EEVEE_SAMPLES, float(np.median(cpu)), float(np.median(wall)), rms(np.stack(pictures), truth, np.zeros(1)))
        say(f"   {way.name:<8} {samples or 'own':>4} samples  {rung.cpu:8.2f} s of processors  {rung.wall:8.2f} s  error {rung.error:.4f}  "
            f"mean {float(pictures[0].mean() / truth.mean()) - 1.0:+.2%}")
        return rung, float(pictures[0].mean() / truth.mean()) - 1.0

    start, start_mean = shot(stock, None)
    own, own_mean = shot(planned, None)
    _, bias = shot(planned, bench.most)
    for way in (stock, planned):
        samples = 1
        while samples < STOCK_EEVEE_SAMPLES and (not way.ladder or way.ladder[-1].error > AS_GOOD * start.error):
            way.ladder.append(shot(way, samples)[0])
            samples *= 2
    # At the end stock is as good as itself, and what is not as good by then has no gain.
    firsts = [soonest([*way.ladder, start], start.error, AS_GOOD - 1.0) for way in (stock, planned)]
    found = {
        "scene": bench.usual.name, "engine": bench.engine, "version": bpy.app.version_string, "way": planned.name, "error": start.error,
        "stock_seconds": seconds(start), "planned_error": own.error, "seconds": seconds(own), "gain": seconds(start) / seconds(own),
        "equal_seconds": seconds(firsts[1]), "gain_equal": seconds(start) / seconds(firsts[1]),
        "gain_ladder": seconds(firsts[0]) / seconds(firsts[1]),
        "stock_mean": start_mean, "mean": own_mean, "bias": bias, "rules": ", ".join(rules)}
    say(f"   => {found['gain']:.2f} x as fast with an error of {own.error:.1%} instead of {start.error:.1%}; as good in {seconds(firsts[1]):.2f} s, "
        f"{found['gain_equal']:.2f} x as fast, and {found['gain_ladder']:.2f} x over the fewest samples of stock that are as good")
    return [found]


def measure(bench: Bench, arguments: argparse.Namespace) -> list[dict]:
    plan = bench.plan()
    rules = list(dict.fromkeys(one.rule.name for one in plan))
    say(f"## {bench.usual.name}, {bench.engine}, Blender {bpy.app.version_string}: {', '.join(rules) or 'nothing to plan'}")
    for one in plan:
        say(f"   {one.rule.name}: {one.reason} ({tuned.figures(one, bench.engine)})")
    stock, others = Way("stock", ()), [Way("planned", arguments.only)]
    large = list(dict.fromkeys(one.rule.name for one in bench.plan(FULL_HD)))
    alike = set(large) <= IDLE and len(bench.usual.frames) == 1  # one large picture is as it was
    if large != rules and not alike:  # the rules that gain in a small picture are not those of a large one
        others.append(Way(LARGE, arguments.only, FULL_HD))
    if arguments.alone:
        others += [Way(rule, (rule,)) for rule in rules]
    truth = bench.truth(arguments.truth, arguments.out.parent / "truth")
    biases = {}
    for way in others:
        compared = compare(Estimate.from_repeats(bench.converged(way, arguments.truth / 2.0)), Estimate.from_repeats(truth))
        biases[way.name] = (compared.mean_relative_error, *compared.mean_relative_interval)
    climb(bench, [stock, *others], truth, arguments.error, arguments.limit, arguments.repeats)
    for way in (stock, *others):
        for rung in way.ladder:
            say(f"   {way.name:<16} {rung.samples:6} samples  {rung.cpu:8.2f} s of processors  {rung.wall:8.2f} s  "
                f"error {rung.error:.4f}")
    for way in others:
        if arguments.means > 1 and way.rules is None and bench.thresholds(way.ladder[-1].samples, way.pixels):
            pictures = np.stack([bench.shoot(way, way.ladder[-1].samples, 2000 + seed)[0] for seed in range(arguments.means)])
            found = compare(Estimate.from_repeats(pictures), Estimate.from_repeats(truth))
            low, high = found.mean_relative_interval
            say(f"   {way.name}: with its noise threshold at {way.ladder[-1].samples} samples the mean is {found.mean_relative_error:+.3%} "
                f"[{low:+.3%}, {high:+.3%}]")
    rows = []
    for way in others:
        try:
            applied = ", ".join(large if way.name == LARGE else rules) if way.rules is None else way.name
            rows.append(row(bench, way, stock, biases[way.name], arguments.error, applied))
        except ValueError as error:
            say(f"   {way.name}: {error}; mean {biases[way.name][0]:+.2%}")
    at_large = 1.0 if alike else next((found["gain_hd"] for found in rows if found["way"] == LARGE), None)
    for found in rows:
        if at_large is not None and found["way"] == "planned":
            found["gain_hd"] = at_large
            found["rules"] += f"; in full HD {', '.join(large) or 'nothing'}"
        say(f"   => {found['way']:<16} gain {found['gain']:7.2f} (clock {found['gain_wall']:.2f}, "
            f"full HD {found['gain_hd']:.2f}) at error {found['error']:.3f}, "
            f"mean {found['bias']:+.3%} [{found['bias_low']:+.3%}, {found['bias_high']:+.3%}]")
    return rows


def table(rows: list[dict]) -> str:
    """Markdown: a line for each scene, losers too, and the geometric means."""
    lines = ["| scene | at error | stock | planned | gain | on the clock | at 1920 x 1080 | mean | 95 % interval | rules |",
             "|---|---:|---:|---:|---:|---:|---:|---:|---|---|"]
    for found in rows:
        lines.append(f"| {found['scene']} | {found['error']:.1%} | {found['stock_cpu']:.2f} s | {found['cpu']:.2f} s | "
                     f"{found['gain']:.1f} | "
                     f"{found['gain_wall']:.1f} | {found['gain_hd']:.1f} | {found['bias']:+.2%} | {found['bias_low']:+.2%} to "
                     f"{found['bias_high']:+.2%} | {found['rules']} |")
    means = [geometric_mean([found[name] for found in rows]) for name in ("gain", "gain_wall", "gain_hd")]
    lines.append(f"| geometric mean | | | | **{means[0]:.1f}** | {means[1]:.1f} | {means[2]:.1f} | | | |")
    return "\n".join(lines) + "\n"


def table_eevee(rows: list[dict]) -> str:
    lines = ["| scene | rules | stock: error | mean | planned: error | mean | converged | gain | gain where as good as stock | over stock's fewest samples |",
             "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|"]
    for found in rows:
        lines.append(f"| {found['scene']} | {found['rules'] or 'nothing'} | {found['error']:.1%} | {found['stock_mean']:+.2%} | "
                     f"{found['planned_error']:.1%} | {found['mean']:+.2%} | {found['bias']:+.2%} | {found['gain']:.1f} | {found['gain_equal']:.1f} | "
                     f"{found['gain_ladder']:.1f} |")
    means = [geometric_mean([found[name] for found in rows]) for name in ("gain", "gain_equal", "gain_ladder")]
    lines.append(f"| geometric mean | | | | | | | {means[0]:.1f} | **{means[1]:.1f}** | {means[2]:.1f} |")
    return "\n".join(lines) + "\n"


def say(text: str) -> None:
    print(text, flush=True)


def words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def cells(text: str) -> str:
    pixels, _, steps = text.partition(",")
    if pixels.strip() not in ("1", "2", "4", "8", "16") or not steps.strip().isdecimal() or not 1 <= int(steps) <= EEVEE_STEPS:
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed; give pixels across (1, 2, 4, 8 or 16) and steps (1 to "
                                         f"{EEVEE_STEPS}), such as 2,192")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=[scene.name for scene in usual.SCENES], metavar="SCENE")
    parser.add_argument("--engine", choices=(CYCLES, EEVEE), default=CYCLES)
    parser.add_argument("--size", type=int, default=48, help="width of the pictures in pixels")
    parser.add_argument("--repeats", type=int, default=3, help="pictures of each sample count")
    parser.add_argument("--error", type=float, default=0.03, help="relative RMSE at which the ladders are read if both pass it")
    parser.add_argument("--limit", type=float, default=20.0, help="processor seconds of the samples at which a ladder ends")
    parser.add_argument("--truth", type=float, default=120.0, help="processor seconds of a truth")
    parser.add_argument("--means", type=int, default=0, help="pictures from which the mean with a noise threshold is measured")
    parser.add_argument("--converged", type=int, default=64, help="samples of EEVEE's converged picture")
    parser.add_argument("--finest", type=cells, default=FINEST, metavar="PIXELS,STEPS", help="cells of EEVEE's truth: pixels across, and steps along the view")
    parser.add_argument("--pilot", action="store_true", help="plan EEVEE with a pilot")
    parser.add_argument("--clock", action="store_true", help="gains of EEVEE by the clock")
    parser.add_argument("--alone", action="store_true", help="measure each rule of the plan by itself too")
    parser.add_argument("--only", type=words, help="apply only these rules")
    parser.add_argument("--without", type=words, default=(), help="plan without these rules")
    parser.add_argument("--out", type=Path, default=Path("bench/plan.csv"))
    parser.add_argument("--table", type=Path, help="write the planned rows as markdown")
    arguments = parser.parse_args()
    if arguments.converged < STOCK_EEVEE_SAMPLES:
        parser.error(f"--converged must be >= {STOCK_EEVEE_SAMPLES}, the samples that EEVEE starts with, got {arguments.converged}")
    rows = []
    for name in arguments.scenes:
        most = MOST_SAMPLES if arguments.engine == CYCLES else arguments.converged
        bench = Bench(usual.by_name(name), arguments.engine, arguments.size, arguments.without, most, arguments.finest, arguments.pilot)
        rows += (measure if arguments.engine == CYCLES else measure_eevee)(bench, arguments)
        if rows:
            arguments.out.parent.mkdir(parents=True, exist_ok=True)
            with open(arguments.out, "w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, list(rows[0]))
                writer.writeheader()
                writer.writerows(rows)
    planned = [found for found in rows if found["way"] == "planned"]
    if planned:
        text = (table if arguments.engine == CYCLES else table_eevee)(planned)
        say(text)
        if arguments.table:
            arguments.table.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
