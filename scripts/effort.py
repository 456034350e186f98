# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether renders to an error reach it: presets at several targets against a much longer reference.

    python scripts/effort.py [NAME ...] [--targets 10%,5%] [--seeds 2] [--size 16] [--rays 1024]

For each run: the error that is stated, its 95 % bound, and the relative RMSE against the reference, of which the reference's own
noise is a part. Prints a Markdown table, and how often the bound held.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import converge  # noqa: E402
from volumetrics_addon.cli.main import _tolerance, _whole  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
from volumetrics_addon.plan.model import CYCLES  # noqa: E402

PRESETS = ("emerald-sphere", "morning-valley", "theatre-spot", "stained-glass", "mist-bank")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("preset", nargs="*", default=PRESETS)
    parser.add_argument("--targets", default="10%,5%")
    parser.add_argument("--seeds", type=_whole(1, 1000), default=2)
    parser.add_argument("--size", type=_whole(1, 512), default=16)
    parser.add_argument("--rays", type=_whole(1, 1 << 16), default=1024,
                        help="of the reference, for each of its pixels and eight repeats")
    arguments = parser.parse_args()
    targets = [_tolerance(text) for text in arguments.targets.split(",")]
    print("| preset | target | stated | at most | measured | noise of the reference | rounds x samples | seconds |")
    print("|---|---|---|---|---|---|---|---|")
    held = runs = reached = 0
    for name in arguments.preset:
        preset = load(name)
        width, height = verify.image_size(preset, arguments.size)
        scene = verify.scene_of(preset, CYCLES)
        truth = verify.reference_of(scene, width, height, samples=arguments.rays, seed=1 << 20)
        level = truth.image.mean()
        own = float(np.sqrt(np.mean(truth.error_estimate**2)) / level)
        for target in targets:
            for seed in range(arguments.seeds):
                made = converge.render(preset, CYCLES, width, height, error=target, scene=scene, seed=1000 * seed)
                error = float(np.sqrt(np.mean((made.image - truth.image) ** 2)) / level)
                runs, held, reached = runs + 1, held + (error <= made.upper_bound), reached + made.reached
                print(f"| `{name}` | {target:.1%} | {made.relative_error:.2%} | {made.upper_bound:.2%} | {error:.2%} | {own:.2%} | "
                      f"{made.rounds} x {made.samples} | {made.seconds:.1f} |", flush=True)
    print(f"\nThe bound held in {held} of {runs} runs; {reached} reached their target.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
