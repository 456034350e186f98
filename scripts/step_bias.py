# SPDX-License-Identifier: GPL-3.0-or-later
"""Bias and cost of ray-marching steps in Cycles, against the reference: the measurement behind plan/rules.py.

    python scripts/step_bias.py [--presets morning-valley,cumulus] [--steps 0.1,0.3,1.0] [--size 48] [--samples 64]

A step is given in units of the medium's smallest feature (scale height, or the noise's finest edge). Where this Blender
has unbiased null-scattering, it is measured beside, in the same run.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import compat, render  # noqa: E402
from volumetrics_addon.compare.statistics import Estimate, compare  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
from volumetrics_addon.plan import rules  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presets", default="morning-valley,cumulus")
    parser.add_argument("--steps", default="0.1,0.3,1.0")
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=4)
    arguments = parser.parse_args()
    steps = [float(word) for word in arguments.steps.split(",")]
    if compat.current().volume_biased:
        steps.append(0.0)
    for name in arguments.presets.split(","):
        preset = load(name)
        scene = verify.scene_of(preset)
        reference = Estimate.from_repeats(verify.reference_of(scene, arguments.size, arguments.size).repeats)
        for step in steps:
            rules.MARCHING_STEP = step
            rendered = render.render(preset, scene, "cycles", arguments.size, arguments.size, arguments.samples,
                                     repeats=arguments.repeats)
            result = compare(Estimate.from_repeats(rendered.images), reference)
            low, high = result.mean_relative_interval
            print(f"{name:<16} {'step ' + format(step, 'g') if step else 'unbiased':<10} {rendered.seconds:6.1f} s  "
                  f"mean {result.mean_relative_error:+.3%} [{low:+.3%}, {high:+.3%}]  rmse {result.rmse:.2%}", flush=True)


if __name__ == "__main__":
    main()
