# SPDX-License-Identifier: GPL-3.0-or-later
"""Render until a stated error is reached, or as far as a time allows; what was interrupted goes on where it stopped.

The error is the relative RMSE of the picture against the converged one, sqrt(mean((x - t)^2)) / mean(t) over pixels and channels:
noise, measured from the spread of the rounds, and bias, measured once on a small picture, added in quadrature. Each comes with
what it stays under with 95 % confidence (plan.effort.noise_bound, bias.Bias), and a target is reached when both together are
below it.

A picture may be denoised: two halves of the rounds are, and their mean is the picture, whose error is told by comparing each with
the other half (compare.held_out). It is taken where it is closer than the rounds' own mean, and a round is then shorter.

Where a pilot finds the noise in few places, a round is rendered in rectangles with samples of their own (compare.allocation), all
rounds alike.

Cycles renders rounds of equally many samples with the seeds ``seed``, ``seed`` + 1, ... and the picture is their mean. A pilot
settles the samples of a round, from the variance and times it measures; from there on times decide only where to stop, so that
equally many rounds of equally many samples are the same pixels to the last bit. EEVEE has no seeds: it climbs a ladder of
pictures with four times the samples each, whose differences tell the noise (plan.effort.ladder_error).
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..compare import allocation, held_out
from ..compare.allocation import Allocation, Region
from ..compare.rounds import Rounds
from ..parameters.preset import Preset
from ..plan import effort
from ..plan.catalogue import LEAST_PIXELS
from ..plan.effort import Pilot
from ..plan.model import CYCLES, EEVEE, Decision
from ..plan.rules import MOST_SAMPLES
from ..plan.tuning import MOST_FROXELS
from ..scene.model import Scene
from . import bias as bias_of_pictures
from . import identity, settings, stage
from .bias import Bias
from .denoising import denoised
from .stage import Stage

PILOT_SIZE = 64  # pixels along the longer side, of the picture that is timed
PILOT_SECONDS = 0.3  # of its longest render, at least
# Of the picture on which bias is measured. The RMSE of noise that is left after its subtraction falls with the fourth root of the
# pixels but each of them takes paths: few large pixels tell a bias soonest. EEVEE's media are cells of the screen, and it has no
# noise to speak of.
BIAS_SIZE = {CYCLES: 8, EEVEE: 48}
BIAS_GOAL, BIAS_ENOUGH = 0.5, 0.8  # of the error: what noise may then have is 87 % and 60 % of it
LEAST_ERROR = 0.01  # where neither error nor noise says how closely bias is worth knowing
BIAS_SHARE, BIAS_SECONDS = 0.2, 30.0  # of the time budget; without one, or what the picture takes where that is more
LEAST_SECONDS = 10.0  # of a budget in which bias is measured
EEVEE_BIAS_SAMPLES = 64
PILOT_SEED = 1 << 30  # and upwards: none of a picture's own
CELLS, FIRST_ORDER = 1.6, 2.0  # error of EEVEE's cells over the difference to cells of half the width, see _against_finer
FIRST_RUNG, RUNG = 4, 4  # samples of EEVEE's first picture, and the factor to the next
MOST_EEVEE_SAMPLES = 1 << 14
SAVE_SECONDS = 5.0  # between two checkpoints
ALLOCATION_SHARE = 0.05  # of the seconds that a picture is expected to take, for finding where its noise is
ALLOCATION_SECONDS = 0.1  # of the samples of each of that pilot's pictures, at least: shorter ones tell neither noise nor time
ALLOCATION_PICTURES = 4  # of that pilot: two halves, each of which tells a variance
ALLOCATION_SAMPLES = 1024  # of each, at most
ALLOCATION_SIZE, ALLOCATION_ENOUGH = 256, 16  # pixels of its longer side at most, which is doubled where so many samples are left
ALLOCATION_GAIN = 1.2  # in seconds at equal error, at least
LEAST_LEARNED = 16  # samples of a rectangle of it where renders learn, or half of a round's
TIMED_SHARE = 0.1  # of a short render's time, which its samples are taken to have at least
DENOISED = 3.0  # by which denoising lessens the noise, as rounds are planned
DENOISING_COSTS = 0.25  # rounds are denoised again when so much of their number has come to them
HEAVY = 0.5  # share of the spread that one round may have before it is told
# Seconds of writing and reading a picture, for each of its pixels: part of every round, and too little to see in a pilot.
PIXEL_SECONDS = 2.5e-7

Say = Callable[[str], None]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Denoised:
    """What denoising makes of so many rounds: the picture, its relative RMSE and what that stays under with 95 % confidence,
    noise included; ``mean_change``: of the picture's mean by it."""

    image: np.ndarray = field(repr=False)
    value: float
    upper: float
    mean_change: float

    def to_json(self) -> dict[str, float]:
        return {"value": self.value, "upper": self.upper, "mean_change": self.mean_change}


@dataclass(frozen=True)
class Converged:
    """A picture with its error, see the module. ``image`` and ``standard_error`` (height, width, 3), row 0 at the top.

    ``relative_error``, ``upper_bound``: noise and bias together, and what they stay under with 95 % confidence; ``noise`` and
    ``noise_upper``: noise alone. All are infinite where they are not known. ``bias``: None where it was not measured.
    ``denoised``: None where the picture is not; ``noise`` and ``standard_error`` are those without.
    ``samples``: of each round, the most that a pixel has on average where ``regions`` have their own.
    ``reached``: whether what was asked for is reached; ``stopped`` by "error", "time" or "samples";
    ``needed_seconds``: what the noise would take in all to be low enough for a target that was missed, None where it is.
    """

    image: np.ndarray = field(repr=False)
    standard_error: np.ndarray = field(repr=False)
    relative_error: float
    upper_bound: float
    noise: float
    noise_upper: float
    bias: Bias | None
    rounds: int
    samples: int
    seconds: float
    reached: bool
    stopped: str
    needed_seconds: float | None = None
    resumed_rounds: int = 0
    notes: tuple[str, ...] = ()
    decisions: tuple[Decision, ...] = ()
    denoised: Denoised | None = None
    regions: tuple[Region, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The figures; null where one is infinite."""
        figures = {name: value for name, value in vars(self).items() if name not in ("image", "standard_error", "decisions")}
        figures["denoised"] = self.denoised and self.denoised.to_json()
        figures["regions"] = [asdict(region) for region in self.regions]
        figures["bias"] = None if self.bias is None else {name: _finite(value) for name, value in asdict(self.bias).items()}
        return {name: _finite(value) for name, value in figures.items()} | {
            "confidence": effort.CONFIDENCE, "decisions": [vars(decision) for decision in self.decisions]}


def _finite(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass
class _State:
    """What a checkpoint holds: everything the rest of the render depends on."""

    samples: int = 0
    seconds: float = 0.0
    pilot: Pilot | None = None
    bias: Bias | None = None
    notes: list[str] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    differences: list[float] = field(default_factory=list)  # EEVEE's ladder; its last picture is the only round
    rounds: Rounds = field(default_factory=Rounds)
    regions: list[Region] = field(default_factory=list)  # of a round; none where all its pixels have equally many samples
    denoised: tuple[int, Denoised] | None = None  # of so many rounds; follows from them, and is not kept in a file


class Checkpoint:
    """The state of an unfinished render in a file, for the render of one digest."""

    def __init__(self, path: Path | None, digest: str):
        self.path, self.digest = path, digest

    def load(self, say: Say) -> _State | None:
        """None where there is none, or one of another render, which is said."""
        if self.path is None or not self.path.exists():
            return None
        try:
            with np.load(self.path) as stored:
                meta = json.loads(str(stored["meta"]))
                if meta["digest"] != self.digest:
                    say(f"{self.path} is of another render (scene, size, engine, seed or version differ); starting anew")
                    return None
                rounds = Rounds.restored(stored)
        except (OSError, ValueError, KeyError) as error:
            say(f"{self.path} cannot be read ({error}); starting anew")
            return None
        known = meta["bias"] and Bias(**meta["bias"] | {"interval": tuple(meta["bias"]["interval"])})
        pilot = meta["pilot"] and Pilot(**meta["pilot"] | {"by_samples": ()})
        return _State(meta["samples"], meta["seconds"], pilot, known, meta["notes"],
                      [Decision(**values) for values in meta["decisions"]], meta["differences"], rounds,
                      [Region(**values) for values in meta["regions"]])

    def save(self, state: _State, seconds: float) -> None:
        if self.path is None:
            return
        meta = {"digest": self.digest, "samples": state.samples, "seconds": seconds, "notes": state.notes,
                "pilot": state.pilot and asdict(state.pilot), "bias": state.bias and asdict(state.bias),
                "decisions": [vars(decision) for decision in state.decisions], "differences": state.differences,
                "regions": [asdict(region) for region in state.regions]}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        partial = self.path.with_name(f"{self.path.name}.{os.getpid()}.npz")
        try:
            np.savez(partial, meta=np.array(json.dumps(meta)), **state.rounds.state())
            os.replace(partial, self.path)
        finally:
            partial.unlink(missing_ok=True)

    def remove(self) -> None:
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def checkpoint_path(out: Path) -> Path:
    """Of the picture ``out``, beside it."""
    return out.with_name(f".{out.name}.partial.npz")


@dataclass
class _Task:
    """What was asked for, and the clock, which goes on over interruptions."""

    engine: str
    width: int
    height: int
    seed: int
    error: float | None
    seconds: float | None
    most_samples: int
    denoise: bool
    allocate: bool
    progress: Progress
    say: Say
    started: float = field(default_factory=time.perf_counter)
    spent: float = 0.0  # before an interruption
    learns: bool = False  # see plan.effort.learned_samples

    @property
    def denoised(self) -> float:
        """By what denoising is hoped to divide the noise."""
        return DENOISED if self.denoise else 1.0

    def elapsed(self) -> float:
        return self.spent + time.perf_counter() - self.started


def render(source: Preset | bpy.types.Scene, engine: str, width: int, height: int, *, error: float | None = None,
           seconds: float | None = None, scene: Scene | None = None, seed: int = 0, round_samples: int | None = None,
           most_samples: int | None = None, checkpoint: Path | None = None, digest: str | None = None,
           save_seconds: float = SAVE_SECONDS, prepare: Callable[[bpy.types.Scene], None] | None = None,
           without: Collection[str] = (), denoise: bool = False, allocate: bool = True, quiet: bool = True,
           progress: Progress | None = None, say: Say | None = None) -> Converged:
    """Render a preset, or a scene of the open file, until its relative error is ``error`` or ``seconds`` are spent.

    ``scene``: a preset's Scene (``verify.scene_of`` makes it). ``round_samples``: samples of a round, not those a pilot finds.
    ``most_samples``: limit of all samples of a pixel. ``checkpoint``: file from which an interrupted render goes on, and to which
    it is saved; ``digest`` tells whose it is (``identity``), and for a Blender scene has to be given with it. It is removed
    when the target is reached, and kept where time or samples ended first, for a longer run. ``prepare`` is called with a
    Blender scene before its first render; ``without`` names rules of a preset's plan that are switched off. ``denoise``: whether a
    picture of Cycles may be denoised, where that brings it closer; ``allocate``: whether its samples may go where the noise is,
    which ``round_samples`` excludes. Times count from the call, and over interruptions.

    Raises ValueError on values out of range, RenderError when the engine fails.
    """
    _check(error, seconds, round_samples, most_samples, width, height)
    if isinstance(source, Preset):
        digest = digest or identity.of_preset(source, engine, width, height, seed)
    elif checkpoint is not None and not digest:
        raise ValueError("a checkpoint of a Blender scene needs a digest of its content; give one, such as identity.of_blend")
    limit = min(most_samples or MOST_SAMPLES, MOST_SAMPLES if engine == CYCLES else MOST_EEVEE_SAMPLES)
    task = _Task(engine, width, height, seed, error, seconds, limit,
                 denoise and engine == CYCLES and width * height >= LEAST_PIXELS, allocate and round_samples is None,
                 progress or (lambda what, share: None), say or (lambda text: None))
    file = Checkpoint(checkpoint, digest or "")
    state = file.load(task.say)
    if state is not None and round_samples not in (None, state.samples) and engine == CYCLES:
        task.say(f"{checkpoint} has rounds of {state.samples} samples, {round_samples} are asked for; starting anew")
        state = None
    if state is not None and state.regions and not task.allocate:
        task.say(f"{checkpoint} has rounds with more samples where the noise is, which is not wanted; starting anew")
        state = None
    resumed = 0
    if state is not None:
        resumed, task.spent = state.rounds.count, state.seconds
        task.say(f"going on from {checkpoint}: {_done(engine, state)} in {state.seconds:.0f} s")
    opened = _opener(source, scene, engine, seed, quiet, prepare, effort.TYPICAL_ROUND * width * height, without)
    try:
        if state is None:
            state = _State()
        (_rounds if engine == CYCLES else _ladder)(task, state, file, opened, source, scene, round_samples, save_seconds)
    except KeyboardInterrupt:
        if state.rounds.count:
            file.save(state, task.elapsed())
            raise KeyboardInterrupt(_how_to_go_on(checkpoint)) from None
        raise
    result = _result(task, state, resumed)
    if result.stopped in ("time", "samples") and not result.reached:
        file.save(state, task.elapsed())
    else:
        file.remove()
    return result


def _check(error: float | None, seconds: float | None, round_samples: int | None, most_samples: int | None, width: int,
           height: int) -> None:
    if error is None and seconds is None:
        raise ValueError("neither an error nor a time is given; give error=0.01, seconds=60.0 or both")
    for name, value in (("error", error), ("seconds", seconds)):
        if value is not None and not 0.0 < value < math.inf:
            raise ValueError(f"{name} must be > 0 and finite, got {value}; give error=0.01 for 1 %, seconds=60.0 for a minute")
    for name, count in (("round_samples", round_samples), ("most_samples", most_samples), ("width", width), ("height", height)):
        if count is not None and count < 1:
            raise ValueError(f"{name} must be >= 1, got {count}")


def _how_to_go_on(checkpoint: Path | None) -> str:
    if checkpoint is None:
        return "interrupted"
    return f"interrupted; the same command goes on from the last of its rounds, kept in {checkpoint}"


def _done(engine: str, state: _State) -> str:
    return f"{state.rounds.count} rounds of {state.samples} samples" if engine == CYCLES else f"{state.samples} samples"


def _opener(source: Preset | bpy.types.Scene, scene: Scene | None, engine: str, seed: int, quiet: bool,
            prepare: Callable[[bpy.types.Scene], None] | None, paths: float,
            without: Collection[str]) -> Callable[[], AbstractContextManager[Stage]]:
    """A stage to render on, made when it is first needed."""
    if not isinstance(source, Preset):
        return lambda: stage.of_scene(source, engine, quiet, prepare=prepare)
    return lambda: stage.of_preset(source, _scene_of(source, scene, engine), engine, seed, quiet, paths, without)


def _scene_of(preset: Preset, scene: Scene | None, engine: str) -> Scene:
    from .. import verify

    return scene or verify.scene_of(preset, engine)


# --- rounds in Cycles -----------------------------------------------------------------------------------------------


def _rounds(task: _Task, state: _State, file: Checkpoint, opened: Callable[[], AbstractContextManager[Stage]],
            source: Preset | bpy.types.Scene, scene: Scene | None, round_samples: int | None, save_seconds: float) -> None:
    """Add rounds to the state until there is a reason to stop."""
    if _stop(task, state):
        return
    with opened() as on:
        if state.samples == 0:
            state.decisions = list(on.decisions)
            task.progress("pilot", 0.0)
            state.pilot = pilot(on, task.width, task.height, task.seconds)
            task.learns = on.learns
            _measure_bias(task, state, on, source, scene, round_samples)
            goal = _noise_goal(task, state)
            state.pilot = _resolved(task, state.pilot, goal)
            planned = _scheduled(task, state.pilot, goal, round_samples)
            state.samples = planned.samples
            if task.allocate and on.divisible:
                planned = _allocate(task, state, on, goal, planned)
            if task.error is not None and planned.seconds > 60.0:
                task.say(f"about {planned.rounds} rounds of {planned.samples} samples, {planned.seconds:.0f} s")
        on.interrupted = _how_to_go_on(file.path) if file.path else on.interrupted
        saved = -math.inf if state.rounds.count == 0 else time.perf_counter()
        took: list[float] = []
        while not _stop(task, state, took):
            began = time.perf_counter()
            state.rounds.add(on.shoot(task.width, task.height, state.samples, task.seed + state.rounds.count, state.regions))
            took.append(time.perf_counter() - began)
            if time.perf_counter() - saved >= save_seconds:
                file.save(state, task.elapsed())
                saved = time.perf_counter()
            task.progress(*_progress(task, state, took))


def _scheduled(task: _Task, known: Pilot, noise: float | None, round_samples: int | None = None) -> effort.Schedule:
    """The rounds for this noise, in the time that is left."""
    left = None if task.seconds is None else max(1e-3, task.seconds - task.elapsed())
    return effort.schedule(known, noise, left, most_samples=task.most_samples, learns=task.learns, denoised=task.denoised,
                           samples=round_samples and min(round_samples, task.most_samples))


def _resolved(task: _Task, known: Pilot, noise: float | None) -> Pilot:
    return known if noise is None else effort.resolved(known, noise * task.denoised)


def pilot(on: Stage, width: int, height: int, seconds: float | None = None) -> Pilot:
    """What a sample and a render of the stage cost, and how noisy a sample is, from a picture of at most 64 pixels."""
    small = stage.scaled_size(width, height, min(PILOT_SIZE, max(width, height)))
    timed = lambda samples, seed: _timed(lambda: on.shoot(*small, samples, PILOT_SEED + seed))  # noqa: E731
    timed(1, 0)  # what only the first render does
    image, single = timed(1, 1)
    samples, taken = 1, single
    longest = max(PILOT_SECONDS, 3.0 * single) if seconds is None else min(max(PILOT_SECONDS, 3.0 * single), seconds / 20.0)
    variances = []
    while True:
        again, taken_again = timed(samples, 2)
        level = 0.5 * float(image.mean() + again.mean())
        square = 0.5 * float(np.mean((image - again) ** 2)) * samples
        variances.append((samples, square / level**2 if level > 0.0 else 0.0))
        taken = min(taken, taken_again)
        if samples > 1 and (taken >= longest or samples >= 1 << 14):
            break
        samples *= 4
        image, taken = timed(samples, 1)
    of_sample = max(0.0, taken - single) / (samples - 1)
    pixels = width * height
    return Pilot(variances[-1][1], of_sample * pixels / (small[0] * small[1]),
                 max(0.0, single - of_sample) + PIXEL_SECONDS * pixels, tuple(variances))


def _allocate(task: _Task, state: _State, on: Stage, goal: float | None, planned: effort.Schedule) -> effort.Schedule:
    """Where a round has more samples than elsewhere, into the state; and what is then expected."""
    allocated = allocated_samples(on, task.width, task.height, state.pilot, planned)
    if allocated is None:
        return planned
    found, gain, state.pilot = allocated
    planned = _scheduled(task, state.pilot, goal)
    state.samples = planned.samples
    least = max(1, min(LEAST_LEARNED, state.samples // 2)) if task.learns else 1
    state.regions = found.regions(task.width, task.height, state.samples, least)
    counts = [region.samples for region in state.regions]
    state.decisions.append(Decision(
        "allocation", f"{len(counts)} rectangles with {min(counts)} to {max(counts)} samples a pixel in a round",
        f"noise is in few places: a pilot's pictures tell that it takes {gain:.3g} times as long where every pixel has equally many"))
    return planned


def allocated_samples(on: Stage, width: int, height: int, known: Pilot, planned: effort.Schedule
                      ) -> tuple[Allocation, float, Pilot] | None:
    """Where samples go, what it gains in seconds at equal error (>= ALLOCATION_GAIN), and the pilot with that gain and what the
    rectangles cost; None where they do not pay. ``known`` and ``planned``: of a picture of ``width`` x ``height`` pixels whose pixels
    have equally many samples. Raises RenderError.

    Found on a small picture, as large as the time for it has enough samples, with random numbers that are not the picture's own. It
    is rendered once more in its rectangles: samples where the noise is may take longer than others.
    """
    longer = max(width, height)
    each = max(0.0, known.fixed_seconds - PIXEL_SECONDS * width * height)  # of a render, without its picture
    of_path = max(known.sample_seconds / (width * height), 1e-12)
    paths = (ALLOCATION_SHARE * planned.seconds / ALLOCATION_PICTURES - each) / of_path
    small = stage.scaled_size(width, height, min(PILOT_SIZE, longer))
    while 2 * max(small) <= min(longer, ALLOCATION_SIZE) and paths >= 4 * small[0] * small[1] * ALLOCATION_ENOUGH:
        small = stage.scaled_size(width, height, 2 * max(small))
    if paths * of_path < ALLOCATION_SECONDS or paths < small[0] * small[1]:
        return None
    samples = effort.power_of_two(min(ALLOCATION_SAMPLES, paths / (small[0] * small[1])))
    pictures, taken = zip(*(_timed(lambda: on.shoot(*small, samples, PILOT_SEED + 4 + index)) for index in range(ALLOCATION_PICTURES)))
    pictures = np.stack(pictures)
    seconds, region_seconds = planned.rounds * planned.samples * known.sample_seconds, planned.rounds * each
    gain = allocation.held_out_gain(pictures, samples, seconds, region_seconds)
    found = allocation.allocate(allocation.variance_of(pictures, samples), seconds, region_seconds)
    extra = (len(found.cells) - 1) * each
    pays = lambda cost: cost * seconds / gain + planned.rounds * extra <= seconds / ALLOCATION_GAIN  # noqa: E731
    if not pays(1.0):
        return None
    regions = found.regions(*small, samples)
    _, taken_by_regions = _timed(lambda: on.shoot(*small, samples, PILOT_SEED + 4 + ALLOCATION_PICTURES, regions))
    even = max(min(taken) - each, TIMED_SHARE * min(taken)) / (small[0] * small[1] * samples)
    own = max(taken_by_regions - len(regions) * each, TIMED_SHARE * taken_by_regions) / sum(one.pixels * one.samples for one in regions)
    cost = own / even
    if not pays(cost):
        return None
    return found, gain / cost, replace(known, variance=known.variance / gain, sample_seconds=known.sample_seconds * cost,
                                       fixed_seconds=known.fixed_seconds + extra)


def _timed(make: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    start = time.perf_counter()
    return make(), time.perf_counter() - start


def _level(state: _State) -> float:
    return float(state.rounds.mean.mean())


def _noise(task: _Task, state: _State) -> tuple[float, float]:
    """Relative noise of the picture so far, and its bound."""
    level = _level(state)
    pair = (effort.noise_of(state.rounds.squares), effort.noise_bound(state.rounds.squares)) if task.engine == CYCLES else \
        effort.ladder_error(state.differences)
    if pair[0] == 0.0:
        return 0.0, pair[1]
    return (pair[0] / level, pair[1] / level) if level > 0.0 else (math.inf, math.inf)


def _denoised(state: _State) -> Denoised | None:
    """The rounds so far, denoised; None where a picture has no light."""
    count, level = state.rounds.count, _level(state)
    if level <= 0.0:
        return None
    if state.denoised is None or state.denoised[0] != count:
        halves, variances = state.rounds.halves
        pictures = [denoised(half) for half in halves]
        value, upper = held_out.error(pictures, halves, variances)
        image = (pictures[0] + pictures[1]) / 2.0
        state.denoised = count, Denoised(image, value / level, upper / level, float(image.mean()) / level - 1.0)
    return state.denoised[1]


def _is_denoised_at(count: int) -> bool:
    """Whether so many rounds are looked at denoised: the first that are enough, and then a quarter more each time."""
    at = effort.ROUNDS
    while at < count:
        at += max(1, int(DENOISING_COSTS * at))
    return at == count


def _noise_goal(task: _Task, state: _State) -> float | None:
    return None if task.error is None else effort.noise_left(task.error, state.bias.upper if state.bias else 0.0)


def _stop(task: _Task, state: _State, took: list[float] | None = None) -> str:
    """Why no further round is rendered; empty where there is no reason."""
    count = state.rounds.count
    if count == 0:
        return ""
    goal = _noise_goal(task, state)
    enough = count >= effort.ROUNDS if task.engine == CYCLES else len(state.differences) > 1
    if goal is not None and enough:
        if _noise(task, state)[1] <= goal:
            return "error"
        if task.denoise and _is_denoised_at(count) and (better := _denoised(state)) and better.upper <= goal:
            return "error"
    following = (count + 1) * state.samples if task.engine == CYCLES else RUNG * state.samples
    if following > task.most_samples:
        return "samples"
    if task.seconds is not None:
        expected = sum(took) / len(took) if took else state.pilot.seconds(state.samples)
        if task.engine != CYCLES:
            expected *= RUNG
        if task.elapsed() + expected > task.seconds:
            return "time"
    return ""


def _progress(task: _Task, state: _State, took: list[float]) -> tuple[str, float]:
    noise = _noise(task, state)[1]
    shares, left = [], []
    seconds = sum(took) / len(took)
    goal = _noise_goal(task, state)
    if goal is not None and 0.0 < noise < math.inf:
        shares.append(min(1.0, (goal / noise) ** 2))
        left.append(seconds * state.rounds.count * max(0.0, (noise / goal) ** 2 - 1.0))
    if task.seconds is not None:
        shares.append(min(1.0, task.elapsed() / task.seconds))
        left.append(max(0.0, task.seconds - task.elapsed()))
    known = f"noise {noise:.2%}" if math.isfinite(noise) else "noise unknown"
    text = f"round {state.rounds.count}, {known}" if task.engine == CYCLES else f"{state.samples} samples, {known}"
    return (f"{text}, {min(left):.0f} s left", max(shares)) if left else (text, 0.0)


# --- EEVEE's ladder ---------------------------------------------------------------------------------------------------


def _ladder(task: _Task, state: _State, file: Checkpoint, opened: Callable[[], AbstractContextManager[Stage]],
            source: Preset | bpy.types.Scene, scene: Scene | None, round_samples: int | None, save_seconds: float) -> None:
    if state.rounds.count and state.pilot and _stop(task, state):
        return
    with opened() as on:
        if state.samples == 0:
            state.decisions = list(on.decisions)
            on.shoot(8, 8, 1)  # compiles the shaders
            _measure_bias(task, state, on, source, scene)
        on.interrupted = _how_to_go_on(file.path) if file.path else on.interrupted
        took: list[float] = []
        while not _stop(task, state, took[-1:]):
            samples = RUNG * state.samples if state.samples else min(round_samples or FIRST_RUNG, task.most_samples)
            image, seconds = _timed(lambda: on.shoot(task.width, task.height, samples))
            took.append(seconds)
            if state.rounds.count:
                state.differences.append(float(np.sqrt(np.mean((image - state.rounds.mean) ** 2))))
            state.samples, state.pilot = samples, Pilot(0.0, seconds / samples, 0.0)
            state.rounds = Rounds()
            state.rounds.add(image)
            file.save(state, task.elapsed())
            task.progress(*_progress(task, state, took[-1:]))
        if on.missing_shadows and on.missing_shadows not in state.notes:
            state.notes.append(on.missing_shadows)


# --- bias -------------------------------------------------------------------------------------------------------------


def _measure_bias(task: _Task, state: _State, on: Stage, source: Preset | bpy.types.Scene, scene: Scene | None,
                  round_samples: int | None = None) -> None:
    """The bias of the stage's small picture into the state; a note where it cannot be known."""
    if task.seconds is not None and task.seconds < LEAST_SECONDS:
        state.notes.append(f"bias is not in this error: it is measured from {LEAST_SECONDS:g} s on")
        return
    limits = _bias_effort(task, state)
    small = stage.scaled_size(task.width, task.height, min(BIAS_SIZE[task.engine], max(task.width, task.height)))
    samples = EEVEE_BIAS_SAMPLES
    if task.engine == CYCLES:
        of_sample = max(state.pilot.sample_seconds * small[0] * small[1] / (task.width * task.height), 1e-7)
        samples = min(4096, max(16, effort.power_of_two(state.pilot.fixed_seconds / of_sample)))
        if task.learns:  # the fewer samples the more bias: no more than a round will have
            samples = min(samples, _scheduled(task, _resolved(task, state.pilot, task.error), task.error, round_samples).samples)
    measured = _against_reference if isinstance(source, Preset) else _against_longer if task.engine == CYCLES else _against_finer
    if measured is _against_finer:
        state.notes.append("the error is against what EEVEE comes to with ever finer cells and more samples: a file of your own has no "
                           "reference")
    try:
        state.bias = measured(task, on, source, scene, small, samples, limits)
        if state.bias is None:
            state.notes.append("bias is not in this error: the picture it is measured on is black or not finite")
    except ValueError as error:  # no reference follows such a scene
        state.notes.append(f"bias is not in this error: {error}")


def _bias_effort(task: _Task, state: _State) -> tuple[float, float, float, float]:
    """The bias worth knowing, the one that will do after so many seconds, and the seconds that finding it may take at most."""
    error = task.error or 0.0
    if task.engine == CYCLES:  # no closer than noise will come
        samples = task.most_samples
        if task.seconds is not None:
            samples = min(samples, task.seconds / max(state.pilot.sample_seconds, 1e-9))
        error = max(error, math.sqrt(state.pilot.variance / samples))
    error = error or LEAST_ERROR
    if task.seconds is not None:
        return BIAS_GOAL * error, BIAS_ENOUGH * error, BIAS_SHARE * task.seconds, BIAS_SHARE * task.seconds
    total = effort.schedule(state.pilot, error, most_samples=task.most_samples).seconds if task.engine == CYCLES else 0.0
    return BIAS_GOAL * error, BIAS_ENOUGH * error, max(BIAS_SECONDS, total), math.inf


def _images(on: Stage, size: tuple[int, int], samples: int, seed: int) -> Callable[[int], np.ndarray]:
    """Eight renders to begin with, then as many as there are."""
    return lambda have: np.stack([on.shoot(*size, samples, seed + have + index)
                                  for index in range(max(bias_of_pictures.REPEATS, have))])


def _against_reference(task: _Task, on: Stage, preset: Preset, scene: Scene | None, size: tuple[int, int], samples: int,
                       limits: tuple[float, float, float, float]) -> Bias | None:
    from .. import verify

    truth = _scene_of(preset, scene, task.engine)
    results = []

    def reference(have: int) -> np.ndarray:
        results.append(verify.reference_of(truth, *size, repeats=max(bias_of_pictures.REPEATS, have), seed=1 + have))
        return results[-1].repeats

    deterministic = task.engine == EEVEE
    mine = (lambda have: on.shoot(*size, samples)[None]) if deterministic else _images(on, size, samples, PILOT_SEED + 16)
    found = bias_of_pictures.measure(mine, reference, "", *limits, noisy=not deterministic, independent=True, samples=samples,
                                     systematic=lambda: results[-1].systematic, progress=task.progress)
    return found and replace(found, against=f"the reference, {results[-1].integrator.replace('_', ' ')}")


def _against_longer(task: _Task, on: Stage, scene: bpy.types.Scene, _: Scene | None, size: tuple[int, int], samples: int,
                    limits: tuple[float, float, float, float]) -> Bias | None:
    """Against the scene with four times the samples in a render, a quarter of the step through volumes, and no clamps."""
    render_longer = _images(on, size, RUNG * samples, PILOT_SEED + (1 << 20))

    def longer(have: int) -> np.ndarray:
        with _lifted(scene):
            return render_longer(have)

    return bias_of_pictures.measure(_images(on, size, samples, PILOT_SEED + 16), longer,
                                    "itself with four times the samples, a quarter of the volume step, no clamps", *limits,
                                    samples=samples, progress=task.progress)


def _against_finer(task: _Task, on: Stage, scene: bpy.types.Scene, _: Scene | None, size: tuple[int, int], samples: int,
                   limits: tuple[float, float, float, float]) -> Bias | None:
    """EEVEE's error by the width of its cells: against cells half as wide and steps half as long, at the picture's own size.

    An error of first order in the width is twice the difference; measured were 1.4 to 1.9 times (foggy-street, spot-haze, noise-cube and
    forest in 96 x 54 pixels, cells of 8 and 4, against cells of one and 256 steps). Raises ValueError where there are no finer cells,
    they take longer than the budget, or their shadows have no memory.
    """
    tile, slices = int(scene.eevee.volumetric_tile_size), scene.eevee.volumetric_samples
    narrow, deep = max(1, tile // 2), min(256, 2 * slices)
    if (narrow, deep) == (tile, slices):
        raise ValueError("EEVEE has no finer cells")
    froxels = lambda width, depth: task.width * task.height / width**2 * depth  # noqa: E731
    if froxels(narrow, deep) > MOST_FROXELS:
        deep = slices
    if froxels(narrow, deep) > MOST_FROXELS or narrow == tile and deep == slices:
        raise ValueError(f"finer cells would be more than the {MOST_FROXELS} up to which no lamp was lost")
    start = time.perf_counter()
    own = on.shoot(task.width, task.height, FIRST_RUNG)
    if (time.perf_counter() - start) * (1.0 + froxels(narrow, deep) / froxels(tile, slices)) > limits[3]:
        raise ValueError("finer cells take longer than the time allows")
    before, on.shadow_pages = settings.apply(scene, {
        "eevee.volumetric_tile_size": str(narrow), "eevee.volumetric_samples": deep}), (0, 0)
    try:
        closer = on.shoot(task.width, task.height, FIRST_RUNG)
    finally:
        settings.restore(scene, before)
        missing, on.shadow_pages = on.missing_shadows, (0, 0)  # the picture's own shots tell theirs
    if missing:
        raise ValueError("finer cells have no memory for their shadows")
    mean = float(closer.mean())
    if not (np.isfinite(own).all() and np.isfinite(closer).all()) or mean <= 0.0:
        return None
    difference, change = float(np.sqrt(np.mean((own - closer) ** 2))) / mean, float(own.mean()) / mean - 1.0
    return Bias(CELLS * difference, FIRST_ORDER * difference, CELLS * change, tuple(sorted((0.0, FIRST_ORDER * change))),
                f"cells {narrow} instead of {tile} pixels wide and {deep} instead of {slices} steps",
                task.width, task.height, time.perf_counter() - start)


@contextmanager
def _lifted(scene: bpy.types.Scene) -> Iterator[None]:
    cycles = scene.cycles
    before = settings.apply(scene, {
        "cycles.sample_clamp_direct": 0.0, "cycles.sample_clamp_indirect": 0.0,
        "cycles.volume_step_rate": max(0.01, cycles.volume_step_rate / 4.0),
        "cycles.volume_max_steps": min(65536, 4 * cycles.volume_max_steps)})
    try:
        yield
    finally:
        settings.restore(scene, before)


# --- what came of it ------------------------------------------------------------------------------------------------


def _result(task: _Task, state: _State, resumed: int) -> Converged:
    noise, noise_upper = _noise(task, state)
    bias, rounds = state.bias, state.rounds
    better = _better(task, state)
    value, value_upper = (better.value, better.upper) if better else (noise, noise_upper)
    upper = math.hypot(value_upper, bias.upper if bias else 0.0)
    stopped = _stop(task, state) or "error"
    reached = upper <= task.error if task.error is not None else True
    notes = list(state.notes)
    squares = rounds.squares
    if len(squares) > 1 and max(squares) > HEAVY * sum(squares):
        notes.append(f"one round has {max(squares) / sum(squares):.0%} of the noise: rare bright samples, which more rounds may "
                     "show more of")
    needed = None
    if not reached:
        needed = _needed(task, state, noise, noise_upper)
        notes.append(_missed(task, state, needed))
    error = rounds.standard_error
    if state.differences:  # a ladder knows no pixel by itself
        error = np.full_like(rounds.mean, effort.ladder_error(state.differences)[0])
    decisions = state.decisions
    if better:
        decisions = [*decisions, Decision("denoising", "both halves of the rounds are denoised, the picture is their mean",
                                          f"compared with the other half its error is below {better.upper:.2%}, that of the noise "
                                          f"below {noise_upper:.2%}")]
    return Converged(better.image if better else rounds.mean, error, math.hypot(value, bias.value if bias else 0.0), upper, noise,
                     noise_upper, bias, rounds.count, state.samples, task.elapsed(), reached, stopped, needed, resumed, tuple(notes),
                     tuple(decisions), better, tuple(state.regions))


def _better(task: _Task, state: _State) -> Denoised | None:
    """The denoised picture where the noise does not reach the target and it is closer; None where the rounds' own mean is taken."""
    if not task.denoise or state.rounds.count < effort.FEWEST_ROUNDS:
        return None
    upper, goal = _noise(task, state)[1], _noise_goal(task, state)
    if goal is not None and upper <= goal:
        return None
    found = _denoised(state)
    return found if found and found.upper < upper else None


def _needed(task: _Task, state: _State, noise: float, noise_upper: float) -> float | None:
    """Seconds until the noise is as low as the target wants, in all; None where it is not known, or low enough already."""
    now = noise_upper if math.isfinite(noise_upper) else noise
    goal = _noise_goal(task, state)
    if now <= goal or not math.isfinite(now) or state.pilot is None:
        return None
    done = state.rounds.count * state.pilot.seconds(state.samples)
    return max(0.0, task.elapsed() - done) + done * (now / goal) ** 2


def _missed(task: _Task, state: _State, needed: float | None) -> str:
    """Why the target was missed, and what it takes."""
    reasons = []
    if needed is not None:
        why = "the time is spent" if _stop(task, state) == "time" else f"the limit is {task.most_samples} samples"
        goal = _noise_goal(task, state)
        factor = (_noise(task, state)[1] / goal) ** 2
        times = f"{factor:.3g} times the samples and " if math.isfinite(factor) else ""
        reasons.append(f"{why}, and noise takes {times}about {needed:.0f} s in all to fall below {100.0 * goal:.3g}%")
    bias = state.bias
    if bias and bias.upper >= task.error:
        if bias.value >= task.error:
            reasons.append(f"the bias alone is {100.0 * bias.value:.3g}%, and more samples do not lessen it")
        else:
            reasons.append(f"the bias is only known to be below {100.0 * bias.upper:.3g}%, and is measured more closely in "
                           "a longer time")
    return f"the error of {100.0 * task.error:.3g}% was not reached: {'; '.join(reasons) or 'too few rounds tell their spread'}"
