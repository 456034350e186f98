# SPDX-License-Identifier: GPL-3.0-or-later
"""What samples where the noise is bring: users' scenes to one error, against equally many samples and Cycles' own adaptive sampling.

    python scripts/allocation.py [SCENE ...] [--size 160] [--error 0.05] [--limit 12] [--truth 60]

Four ways take turns, in processor seconds of a picture, none denoised: equally many samples for every pixel; the rectangles of
compare.allocation, what finds them included; Blender's start-up settings (adaptive sampling to a threshold of 0.01) with more and
more samples; and adaptive sampling to thresholds that are lowered step by step. Where a way ends before the wanted error, all are read
where it ends. The error is the relative RMSE against pictures of equally many samples, less their variance; the mean is that of
all the ways' pictures whose error is no larger than twice the one that is read.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: E402
import numpy as np  # noqa: E402

from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.bench.equal_error import Rung, at_error, common_error, rms  # noqa: E402
from volumetrics_addon.blender import converge, render, settings, stage  # noqa: E402
from volumetrics_addon.plan.effort import Pilot, Schedule  # noqa: E402
from volumetrics_addon.plan.model import CYCLES  # noqa: E402

TRUTHS = 4
MOST = 1 << 14
THRESHOLDS = [0.3 / 2.0**step for step in range(12)]
EVEN, ALLOCATED, START_UP, THRESHOLD = "even", "allocated", "start-up", "thresholds"

Shoot = Callable[[int, int], tuple[np.ndarray, int]]  # from the rung and the seed: the picture and what counts its rungs


def ways(scene: bpy.types.Scene, on: stage.Stage, pilot: Pilot, width: int, height: int) -> dict[str, Shoot]:
    def allocated(step: int, seed: int) -> tuple[np.ndarray, int]:
        samples = 4**step
        found = converge.allocated_samples(on, width, height, pilot, Schedule(samples, 1, pilot.seconds(samples)))
        return on.shoot(width, height, samples, seed, found[0].regions(width, height, samples) if found else ()), samples

    def adaptive(samples: int, threshold: float, seed: int) -> np.ndarray:
        before = settings.apply(scene, {"cycles.use_adaptive_sampling": True, "cycles.adaptive_threshold": threshold,
                                        "cycles.samples": samples, "cycles.use_sample_subset": False})
        try:
            return render.render_built(scene, width, height, seed=seed)[0]
        finally:
            settings.restore(scene, before)

    return {EVEN: lambda step, seed: (on.shoot(width, height, 4**step, seed), 4**step), ALLOCATED: allocated,
            START_UP: lambda step, seed: (adaptive(4**step, 0.01, seed), 4**step),
            THRESHOLD: lambda step, seed: (adaptive(MOST, THRESHOLDS[step], seed), step + 1)}


def measure(name: str, arguments: argparse.Namespace) -> dict[str, tuple[float, float, float]]:
    """For each way: seconds, change of the mean and its standard error; "at": the error."""
    width, height = arguments.size, round(arguments.size * 9 / 16)
    scene = usual.by_name(name).build()
    with stage.of_scene(scene, CYCLES) as on:
        pilot = converge.pilot(on, width, height)
        shoots = ways(scene, on, pilot, width, height)
        samples = max(16, int(0.5 * arguments.truth / TRUTHS / pilot.sample_seconds))  # the pilot's seconds are those of the clock, on two cores
        truths = np.stack([on.shoot(width, height, samples, 1000 + seed) for seed in range(TRUTHS)])
        truth, variance = truths.mean(axis=0), truths.var(axis=0, ddof=1) / TRUTHS
        ladders: dict[str, list[Rung]] = {way: [] for way in shoots}
        pictures: dict[str, list[list[np.ndarray]]] = {way: [] for way in shoots}
        step, climbing = 0, list(shoots)
        while climbing and step < len(THRESHOLDS):
            for way in list(climbing):
                taken, clock, shots = [], [], []
                for repeat in range(arguments.repeats):
                    cpu, wall = time.process_time(), time.perf_counter()
                    image, rung = shoots[way](step, 10 * step + repeat)
                    taken.append(time.process_time() - cpu)
                    clock.append(time.perf_counter() - wall)
                    shots.append(image)
                ladders[way].append(Rung(rung, float(np.median(taken)), float(np.median(clock)), rms(np.stack(shots), truth, variance)))
                pictures[way].append(shots)
                found = ladders[way][-1]
                print(f"   {name} {way:<11} {found.samples:6} {found.cpu:8.2f} s  error {found.error:.4f}  mean "
                      f"{np.mean(shots) / truth.mean() - 1.0:+.2%}", file=sys.stderr, flush=True)
                if found.error <= arguments.error or found.cpu > arguments.limit or 4**step >= MOST:
                    climbing.remove(way)
            step += 1
    error = common_error(list(ladders.values()), arguments.error)
    result = {"at": (error, 0.0, 0.0)}
    doubt = truths.mean(axis=(1, 2, 3)).std(ddof=1) / TRUTHS**0.5
    for way, ladder in ladders.items():
        means = [image.mean() for rung, shots in zip(ladder, pictures[way]) if rung.error <= 2.0 * error for image in shots]
        spread = np.hypot(np.std(means, ddof=1) / len(means) ** 0.5 if len(means) > 1 else 0.0, doubt)
        result[way] = at_error(ladder, error, "cpu"), float(np.mean(means) / truth.mean() - 1.0), float(spread / truth.mean())
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=[scene.name for scene in usual.SCENES], metavar="SCENE")
    parser.add_argument("--size", type=int, default=160, help="width of the pictures in pixels")
    parser.add_argument("--error", type=float, default=0.05, help="relative RMSE at which the ways are compared if all reach it")
    parser.add_argument("--limit", type=float, default=12.0, help="processor seconds of a picture after which a way ends")
    parser.add_argument("--truth", type=float, default=60.0, help="processor seconds of the truth, about")
    parser.add_argument("--repeats", type=int, default=2, help="pictures of each rung")
    arguments = parser.parse_args()
    print("| scene | at error | even | allocated | gain | start-up | thresholds | mean: allocated | start-up | thresholds |\n"
          "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    for name in arguments.scenes:
        found = measure(name, arguments)
        means = " | ".join(f"{found[way][1]:+.2%} ± {found[way][2]:.2%}" for way in (ALLOCATED, START_UP, THRESHOLD))
        print(f"| {name} | {found['at'][0]:.1%} | {found[EVEN][0]:.1f} s | {found[ALLOCATED][0]:.1f} s | "
              f"{found[EVEN][0] / found[ALLOCATED][0]:.1f} | {found[START_UP][0]:.1f} s | {found[THRESHOLD][0]:.1f} s | {means} |",
              flush=True)


if __name__ == "__main__":
    main()
