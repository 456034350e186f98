# SPDX-License-Identifier: GPL-3.0-or-later
"""What the samples of one render come to: the mean and the noise of users' scenes in Cycles by the samples of each picture, and what
rounds of few and of many samples take to one error.

    python scripts/few_samples.py [SCENE ...] [--size 48] [--seconds 30] [--error 0.03]

Pictures have the scene's plan and equally many samples for every pixel, without denoising. The mean is relative to that of the most
samples, with the standard error of both; the variance is that of one sample, over the square of the mean. Rounds are what
``render --plan --error`` adds up, here of 4 and of 64 samples, at twice the size; their error is the relative RMSE against three
pictures of 2048 samples, less the variance of these. Seconds are those of all processors.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: E402
import numpy as np  # noqa: E402

from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.bench.equal_error import rms  # noqa: E402
from volumetrics_addon.blender import converge, stage, tuning  # noqa: E402
from volumetrics_addon.plan.effort import TYPICAL_ROUND  # noqa: E402
from volumetrics_addon.plan.model import CYCLES  # noqa: E402

SAMPLES = (1024, 256, 64, 32, 16, 8, 4, 2, 1)
ROUNDS = (4, 64)
TRUTHS, TRUTH_SAMPLES = 3, 2048
FEWEST = 6  # pictures


def built(name: str, width: int, height: int) -> bpy.types.Scene:
    scene = usual.by_name(name).build()
    scene.render.engine = "CYCLES"
    tuning.apply(scene, tuning.plan(scene, samples=TYPICAL_ROUND, pixels=width * height))
    return scene


def by_samples(name: str, width: int, height: int, seconds: float) -> None:
    level = doubt = 0.0
    with stage.of_scene(built(name, width, height), CYCLES) as on:
        on.shoot(width, height, 1)  # what only the first render does
        for samples in SAMPLES:
            start, made = time.process_time(), []
            while len(made) < FEWEST or time.process_time() - start < seconds:
                made.append(on.shoot(width, height, samples, 10_000 * samples + len(made)))
            pictures = np.stack(made)
            means = pictures.mean(axis=(1, 2, 3))
            own = means.std(ddof=1) / len(means) ** 0.5
            level, doubt = level or means.mean(), doubt or own
            variance = samples * pictures.var(axis=0, ddof=1).mean() / level**2
            print(f"| {name} | {samples} | {len(made)} | {means.mean() / level - 1.0:+.2%} ± {np.hypot(own, doubt) / level:.2%} | "
                  f"{variance:.1f} |", flush=True)


def by_rounds(name: str, width: int, height: int, error: float) -> None:
    with stage.of_scene(built(name, width, height), CYCLES) as on:
        truths = np.stack([on.shoot(width, height, TRUTH_SAMPLES, 900 + index) for index in range(TRUTHS)])
    truth, variance = truths.mean(axis=0), truths.var(axis=0, ddof=1) / TRUTHS
    for samples in ROUNDS:
        start = time.process_time()
        made = converge.render(built(name, width, height), CYCLES, width, height, error=error, round_samples=samples)
        print(f"| {name} | {made.rounds} x {samples} | {time.process_time() - start:.0f} s | {made.noise_upper:.1%} | "
              f"{rms(made.image[None], truth, variance):.1%} | {made.image.mean() / truth.mean() - 1.0:+.2%} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=["foggy-street", "spot-haze"], metavar="SCENE")
    parser.add_argument("--size", type=int, default=48, help="width of the pictures in pixels")
    parser.add_argument("--seconds", type=float, default=30.0, help="processor seconds for each number of samples, about")
    parser.add_argument("--error", type=float, default=0.03, help="relative RMSE that the rounds are asked for")
    arguments = parser.parse_args()
    width, height = arguments.size, round(arguments.size * 9 / 16)
    print("| scene | samples | pictures | mean | variance of a sample |\n|---|---:|---:|---:|---:|", flush=True)
    for name in arguments.scenes:
        by_samples(name, width, height, arguments.seconds)
    print("\n| scene | rounds x samples | seconds | noise, at most | error, measured | mean |\n|---|---:|---:|---:|---:|---:|", flush=True)
    for name in arguments.scenes:
        by_rounds(name, 2 * width, 2 * height, arguments.error)


if __name__ == "__main__":
    main()
