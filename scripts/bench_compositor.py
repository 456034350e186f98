# SPDX-License-Identifier: GPL-3.0-or-later
"""What fog and air cost as a pass of the compositor: milliseconds of all processors over a picture without them.

A start-up scene with a sun is rendered with one sample in Cycles, without and with the pass, taking turns; the least of several
renders counts. A graphics card is not used.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: E402

from volumetrics_addon.blender import items  # noqa: E402
from volumetrics_addon.blender.render import silenced  # noqa: E402

CASES = (
    ("depth fog, exponential", "fog", {"realisation": "compositor", "profile": "exp"}, False),
    ("height fog, sun", "fog", {"realisation": "compositor"}, False),
    ("height fog, sun and sky", "fog", {"realisation": "compositor"}, True),
    ("air", "air", {"realisation": "compositor"}, False),
)


def start_scene(width: int, height: int, sky: bool) -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=False)
    scene = bpy.context.scene
    bpy.data.lights["Light"].type = "SUN"
    if not sky:
        scene.world = None
    render = scene.render
    render.resolution_x, render.resolution_y, render.engine = width, height, "CYCLES"
    render.compositor_device = "CPU"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    return scene


def seconds() -> tuple[float, float]:
    """Of all processors and of the clock, for one render."""
    cpu, wall = time.process_time(), time.perf_counter()
    with silenced(True):
        bpy.ops.render.render()
    return time.process_time() - cpu, time.perf_counter() - wall


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--width", type=int, default=1920)
    parser.add_argument("--height", type=int, default=1080)
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()
    print(f"Blender {bpy.app.version_string}, {arguments.width} x {arguments.height}")
    print("| pass | nodes | ms of processors | ms on the clock |\n|---|---:|---:|---:|")
    for title, family, values, sky in CASES:
        scene = start_scene(arguments.width, arguments.height, sky)
        item = items.add_item(scene, family, values, "Pass")
        nodes = len(items.live_node(item).node_tree.nodes)
        taken = {True: [], False: []}
        for _ in range(arguments.repeats + 1):  # the first of each loads the scene
            for on in taken:
                scene.render.use_compositing = on
                taken[on].append(seconds())
        cost = [1000.0 * (min(column(taken[True][1:], k)) - min(column(taken[False][1:], k))) for k in (0, 1)]
        print(f"| {title} | {nodes} | {cost[0]:.0f} | {cost[1]:.0f} |", flush=True)


def column(rows: list[tuple[float, float]], index: int) -> list[float]:
    return [row[index] for row in rows]


if __name__ == "__main__":
    main()
