# SPDX-License-Identifier: GPL-3.0-or-later
"""What denoising brings to a render within a time, and whether the error it states is true: users' scenes against long renders."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: E402, F401  (bmesh comes with it)
import numpy as np  # noqa: E402

from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.bench.equal_error import rms  # noqa: E402
from volumetrics_addon.blender import converge, stage  # noqa: E402
from volumetrics_addon.plan.model import CYCLES  # noqa: E402

TRUTHS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=[scene.name for scene in usual.SCENES], metavar="SCENE")
    parser.add_argument("--size", type=int, default=160, help="width of the pictures in pixels")
    parser.add_argument("--seconds", type=float, default=9.9, help="time of each picture; from 10 s on its bias is measured too")
    parser.add_argument("--truth", type=int, default=2048, help=f"samples of each of the {TRUTHS} pictures that are the truth")
    arguments = parser.parse_args()
    width, height = arguments.size, round(arguments.size * 9 / 16)
    print("| scene | denoised | stated | at most | measured | noise alone, measured | time for that by noise |\n"
          "|---|---|---:|---:|---:|---:|---:|")
    for name in arguments.scenes:
        scene = usual.by_name(name).build()
        with stage.of_scene(scene, CYCLES) as on:
            truths = np.stack([on.shoot(width, height, arguments.truth, 1000 + seed) for seed in range(TRUTHS)])
        mean, variance = truths.mean(axis=0), truths.var(axis=0, ddof=1) / TRUTHS
        made = [converge.render(scene, CYCLES, width, height, seconds=arguments.seconds, denoise=denoise) for denoise in (False, True)]
        noisy, best = (rms(picture.image[None], mean, variance) for picture in made)
        print(f"| {name} | {'yes' if made[1].denoised else 'no'} | {made[1].relative_error:.1%} | {made[1].upper_bound:.1%} | {best:.1%} | "
              f"{noisy:.1%} | {(noisy / best) ** 2:.1f} x |", flush=True)


if __name__ == "__main__":
    main()
